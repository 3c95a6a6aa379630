/** What the server tells of a session. `experiment/server/app.py` writes it. */
import type { Texts } from "./texts";

/** A column of liquid in the picture of an answer, in shares of the picture's size. */
export interface Column {
  x: number;
  width: number;
  /** Whether it grows with the share that is judged, or with what is left. */
  judged: boolean;
  /** Its height when that share is 1. */
  full: number;
}

/** How the goal's picture of an answer is drawn; points are shares of its size, y upwards. */
export interface AnswerPicture {
  columns: Column[];
  parts: [number, number][][];
}

export interface Step {
  seq: number;
  kind: "consent" | "check" | "instructions" | "judgment" | "film" | "break" | "debrief";
  phase?: "practice" | "test";
  trial?: number;
  block?: number;
  liquid?: string;
  still?: string;
  film?: string;
}

export interface SliderDesign {
  start: "none" | "centre" | "random" | "fixed";
  start_at: number;
  mouse: "move" | "drag";
  number: boolean;
  trajectory: boolean;
}

/** What is the same for all sessions of an experiment. */
export interface Experiment {
  texts: Texts;
  answer_picture: AnswerPicture;
  /** Colour of each liquid that is shown, #rrggbb. */
  colours: { [liquid: string]: string };
  aspect: number;
  contact: string;
  minutes: number;
  comprehension_attempts: number;
  minimum_width: number;
  minimum_height: number;
  fullscreen: boolean;
  slider: SliderDesign;
}

export interface Farewell {
  code: string;
  redirect: string;
}

/** How a page ends a session; a server can say that it ended otherwise: `stop` has the words. */
export type End = "complete" | "declined" | "screened_out" | "failed_check";

/** How an observer that is simulated answers the judgments, by the step's number. */
export type Answers = { [seq: string]: { response: number; rt: number } };

export interface Session extends Experiment, Partial<Farewell> {
  token: string;
  /** The session's name in files; unlike the token it lets nobody write. */
  key: string;
  participant: string;
  entry: string;
  state: string;
  code: string;
  steps: Step[];
  done: number[];
  simulated?: Answers;
}

export type Body = { [key: string]: unknown };

/** Sessions in files: what is downloaded, what DataPipe and JATOS get, what `--import` takes. */
import type { Entry } from "../outbox";
import type { Session } from "../types";

/** What an object in a file says of its kind; collecting services ask for a `trial_type`. */
export const FORMAT = { format: "pourcast-records", schema_version: 1, trial_type: "pourcast" } as const;

/** Whose records follow. Of a session that no server knows, it says all that identifies it. */
export interface Opening {
  format: "pourcast-records";
  schema_version: 1;
  trial_type: "pourcast";
  session: string;
  entry?: string;
  identifiers?: { [name: string]: string };
  group?: number;
  place?: number;
}

/** A record, with what places it, should its opening be lost. */
export function recordOf({ session, group, place }: Opening, steps: Session["steps"], entry: Entry): object {
  const { seq, body } = entry;
  const kind = steps.find((step) => step.seq === seq)?.kind;
  return { session, seq, kind, group, place, body, trial_type: FORMAT.trial_type };
}

/** One line of JSON, for programs, too, that take more than the newline for a line's end. */
export function lineOf(content: object): string {
  return JSON.stringify(content).replace(
    /[\u0085\u2028\u2029]/g,
    (mark) => `\\u${mark.charCodeAt(0).toString(16).padStart(4, "0")}`,
  );
}

/** A session as a list in JSON, each object on a line of its own, so that half a file is of use. */
export function fileOf(opening: Opening, steps: Session["steps"], entries: Entry[]): string {
  const records = entries.map((entry) => recordOf(opening, steps, entry));
  return `[\n${[opening, ...records].map(lineOf).join(",\n")}\n]\n`;
}

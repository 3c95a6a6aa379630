/**
 * A judgment of a still picture by a slider: the mouse moves it, ENTER hands it in
 * (Bates et al. 2019, section "Experiment 1"). Keyboard and touch work, too.
 */
import { ParameterType, type JsPsych, type JsPsychPlugin, type TrialType } from "jspsych";

import { drawAnswer } from "../picture";
import { fitPicture } from "../screen";
import type { AnswerPicture } from "../types";
import { WATCHED, Watch } from "../watch";
import { escaped, fill } from "../words";

const info = {
  name: "pourcast-slider",
  version: "1.0.0",
  parameters: {
    /** Address of the picture. */
    stimulus: { type: ParameterType.STRING, default: undefined },
    /** Width of the picture over its height. */
    aspect: { type: ParameterType.FLOAT, default: 2 / 3 },
    /** The picture of an answer: columns of liquid, and the goal's parts. */
    answer_picture: { type: ParameterType.COMPLEX, default: { columns: [], parts: [] } },
    /** Colour of the liquid in it. */
    colour: { type: ParameterType.STRING, default: "#2978cc" },
    /** The page's words: progress, question, slider, low, high, value, picture, unset, set, button. */
    words: { type: ParameterType.COMPLEX, default: undefined },
    /** Where the handle stands at first: `none`, `centre`, `random` or `fixed`. */
    start: { type: ParameterType.STRING, default: "none" },
    /** Place of a fixed start, 0 to 1. */
    start_at: { type: ParameterType.FLOAT, default: 0.5 },
    /** Whether the mouse moves the handle (`move`) or drags it (`drag`). */
    mouse: { type: ParameterType.STRING, default: "move" },
    /** Show the answer as a number, too. */
    number: { type: ParameterType.BOOL, default: true },
    /** Record the handle's whole way. */
    trajectory: { type: ParameterType.BOOL, default: false },
  },
  data: {
    /** The answer, 0 (left end) to 1 (right end). */
    response: { type: ParameterType.FLOAT },
    /** Where the handle stood at first; null without one. */
    start: { type: ParameterType.FLOAT },
    /** Time until the handle first moved [s]. */
    first_move: { type: ParameterType.FLOAT },
    /** Number of movements. */
    moves: { type: ParameterType.INT },
    /** What moved the handle last: `mouse`, `touch`, `keyboard` or `none`. */
    input: { type: ParameterType.STRING },
    /** Times [s] and places of the handle; null if not asked for. */
    trajectory: { type: ParameterType.COMPLEX },
    /** Time from the picture to the answer [s]. */
    rt: { type: ParameterType.FLOAT },
    /** Size of the picture when the answer was handed in [points]. */
    picture_width: { type: ParameterType.FLOAT },
    picture_height: { type: ParameterType.FLOAT },
    /** The screen's pixels in a point; page zoom counts. */
    pixel_ratio: { type: ParameterType.FLOAT },
    ...WATCHED,
  },
} as const;

type Info = typeof info;
type Input = "mouse" | "touch" | "keyboard" | "none";

const STEP = 0.01;
const LEAP = 0.1;
const LONGEST_TRAJECTORY = 2000;
/** How far a key moves the handle. */
const SIZES = new Map([
  ["ArrowLeft", -STEP],
  ["ArrowDown", -STEP],
  ["ArrowRight", STEP],
  ["ArrowUp", STEP],
  ["PageDown", -LEAP],
  ["PageUp", LEAP],
  ["Home", -1],
  ["End", 1],
]);
/** A key that is still down from the trial before hands nothing in. */
const DEAF = 200;

export default class SliderPlugin implements JsPsychPlugin<Info> {
  static info = info;

  constructor(private jsPsych: JsPsych) {}

  trial(display: HTMLElement, trial: TrialType<Info>, onLoad: () => void): Promise<void> {
    const slider = new Slider(display, trial);
    return slider.ready.then(() => {
      onLoad();
      return slider.answer.then((data) => this.jsPsych.finishTrial(data));
    });
  }

  simulate(
    trial: TrialType<Info>,
    mode: string,
    options: { data?: { response?: number; rt?: number } },
    onLoad: () => void,
  ): void {
    const response = options.data?.response ?? Math.random();
    const rt = options.data?.rt ?? 1 + 2 * Math.random();
    if (mode === "data-only") {
      onLoad();
      this.jsPsych.finishTrial({
        response,
        start: null,
        first_move: Math.min(0.5, rt),
        moves: 1,
        input: "mouse",
        trajectory: null,
        rt,
        picture_width: null,
        picture_height: null,
        pixel_ratio: null,
        ...new Watch().stop(),
      });
      return;
    }
    const display = this.jsPsych.getDisplayElement();
    void this.trial(display, trial, () => {
      onLoad();
      const bar = display.querySelector(".slider") as HTMLElement;
      const box = bar.getBoundingClientRect();
      const at = { clientX: box.left + response * box.width, clientY: box.top + box.height / 2 };
      const event = { ...at, bubbles: true, pointerType: "mouse", buttons: 1 };
      setTimeout(() => bar.dispatchEvent(new PointerEvent("pointerdown", event)), 300);
      setTimeout(
        () => document.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter" })),
        Math.max(600, Math.min(1000 * rt, 3000)),
      );
    });
  }
}

/** The page of one judgment. */
class Slider {
  /** Resolves when the picture is to be seen. */
  ready: Promise<void>;
  /** Resolves with the data, when the answer is handed in. */
  answer: Promise<object>;

  private value: number | null = null;
  private start: number | null = null;
  private began = 0;
  private firstMove: number | null = null;
  private moves = 0;
  private input: Input = "none";
  private way: [number, number][] = [];
  private watch = new Watch();
  private handIn: (data: object) => void = () => undefined;

  private picture: HTMLImageElement;
  private bar: HTMLElement;
  private handle: HTMLElement;
  private shown: HTMLElement;
  private hint: HTMLElement;
  private button: HTMLButtonElement;

  constructor(
    display: HTMLElement,
    private trial: TrialType<Info>,
  ) {
    const words = trial.words as { [name: string]: string };
    const word = (name: string) => escaped(words[name] ?? "");
    display.innerHTML = `
      <div class="trial">
        <p class="progress">${word("progress")}</p>
        <h1>${word("question")}</h1>
        <img class="still" alt="${word("picture").replace(/"/g, "&quot;")}">
        <div class="slider" role="slider" tabindex="0" aria-valuemin="0" aria-valuemax="100">
          <div class="track"></div><div class="handle" hidden></div>
        </div>
        <div class="ends" aria-hidden="true"><span>${word("low")}</span><span>${word("high")}</span></div>
        <div class="answer"><div class="shown"></div></div>
        <p class="hint" aria-live="polite"></p>
        <button class="jspsych-btn" type="button" disabled>${word("button")}</button>
      </div>`;
    const find = (css: string) => display.querySelector(css) as HTMLElement;
    this.picture = find(".still") as HTMLImageElement;
    this.bar = find(".slider");
    this.handle = find(".handle");
    this.shown = find(".shown");
    this.hint = find(".hint");
    this.button = find("button") as HTMLButtonElement;
    this.bar.setAttribute("aria-label", words["slider"] ?? "");
    find(".trial").style.setProperty("--aspect", String(trial.aspect));
    this.answer = new Promise((resolve) => (this.handIn = resolve));
    this.ready = this.show();
  }

  private async show(): Promise<void> {
    this.picture.src = this.trial.stimulus;
    await this.picture.decode().catch(() => undefined);
    this.start = this.firstPlace();
    if (this.start !== null) this.value = this.start;
    this.draw();
    fitPicture();
    // The clock starts when the screen shows the picture.
    await new Promise(requestAnimationFrame);
    this.began = performance.now();
    this.listen();
    this.bar.focus({ preventScroll: true });
  }

  private firstPlace(): number | null {
    if (this.trial.start === "centre") return 0.5;
    if (this.trial.start === "random") return Math.round(100 * Math.random()) / 100;
    return this.trial.start === "fixed" ? (this.trial.start_at as number) : null;
  }

  private listen(): void {
    this.bar.addEventListener("pointerdown", this.pressed);
    this.bar.addEventListener("pointermove", this.moved);
    this.button.addEventListener("click", this.submit);
    document.addEventListener("keydown", this.key);
    window.addEventListener("focus", this.refocus);
    window.addEventListener("resize", fitPicture);
  }

  private refocus = () => this.bar.focus({ preventScroll: true });

  private pressed = (event: PointerEvent) => {
    if (event.isTrusted) this.bar.setPointerCapture(event.pointerId);
    this.point(event);
  };

  private moved = (event: PointerEvent) => {
    const held = event.buttons > 0;
    if (held || (event.pointerType === "mouse" && this.trial.mouse === "move")) this.point(event);
  };

  private point(event: PointerEvent): void {
    const box = this.bar.getBoundingClientRect();
    if (!box.width) return; // A bar that is not to be seen has no places.
    this.move((event.clientX - box.left) / box.width, event.pointerType === "mouse" ? "mouse" : "touch");
  }

  private key = (event: KeyboardEvent) => {
    if (event.key === "Enter") {
      event.preventDefault();
      if (!event.repeat && performance.now() - this.began > DEAF) this.submit();
      return;
    }
    const size = SIZES.get(event.key);
    if (size === undefined || event.altKey || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    const larger = event.shiftKey && Math.abs(size) === STEP ? 10 : 1;
    // From the middle, as there is no handle before.
    this.move(Math.round(100 * ((this.value ?? 0.5) + larger * size)) / 100, "keyboard");
  };

  private move(place: number, input: Input): void {
    const value = Math.min(1, Math.max(0, place));
    const time = this.seconds();
    this.value = value;
    this.input = input;
    this.moves += 1;
    this.firstMove ??= time;
    if (this.trial.trajectory && this.way.length < LONGEST_TRAJECTORY) this.way.push([time, value]);
    this.draw();
  }

  private draw(): void {
    const words = this.trial.words as { [name: string]: string };
    const set = this.value !== null;
    this.button.disabled = !set;
    this.handle.hidden = !set;
    this.hint.textContent = words[set ? "set" : "unset"] ?? "";
    const answer = this.trial.answer_picture as AnswerPicture;
    const picture = drawAnswer(answer, this.trial.colour as string, this.value);
    this.shown.replaceChildren(picture);
    if (this.value === null) {
      this.bar.setAttribute("aria-valuetext", words["unset"] ?? "");
      return;
    }
    const share = Math.round(100 * this.value);
    const text = fill(words["value"] ?? "", { share, rest: 100 - share });
    this.handle.style.left = `${100 * this.value}%`;
    this.bar.setAttribute("aria-valuenow", String(share));
    this.bar.setAttribute("aria-valuetext", text);
    if (this.trial.number) {
      const line = document.createElement("p");
      line.textContent = text;
      this.shown.append(line);
    }
  }

  private seconds(): number {
    return Math.round(performance.now() - this.began) / 1000;
  }

  private submit = () => {
    if (this.value === null) return;
    document.removeEventListener("keydown", this.key);
    window.removeEventListener("focus", this.refocus);
    window.removeEventListener("resize", fitPicture);
    const { width, height } = this.picture.getBoundingClientRect();
    this.handIn({
      response: Math.round(1e4 * this.value) / 1e4,
      start: this.start,
      first_move: this.firstMove,
      moves: this.moves,
      input: this.input,
      trajectory: this.trial.trajectory ? this.way : null,
      rt: this.seconds(),
      picture_width: Math.round(10 * width) / 10,
      picture_height: Math.round(10 * height) / 10,
      pixel_ratio: Math.round(1e4 * window.devicePixelRatio) / 1e4,
      ...this.watch.stop(),
    });
  };
}

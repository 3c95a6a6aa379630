/** A film of what happens, shown once; ENTER or the button goes on when it is over. */
import { ParameterType, type JsPsych, type JsPsychPlugin, type TrialType } from "jspsych";

import { WATCHED, Watch } from "../watch";
import { escaped } from "../words";

const info = {
  name: "pourcast-film",
  version: "1.0.0",
  parameters: {
    /** Address of the film. */
    stimulus: { type: ParameterType.STRING, default: undefined },
    /** Width of the picture over its height. */
    aspect: { type: ParameterType.FLOAT, default: 2 / 3 },
    /** The page's words: progress, title, picture, unplayable, button. */
    words: { type: ParameterType.COMPLEX, default: undefined },
    /** After so long without a picture the film is given up [ms]. */
    patience: { type: ParameterType.INT, default: 10_000 },
  },
  data: {
    /** Whether it was shown to its end. */
    played: { type: ParameterType.BOOL },
    /** How often it had to wait for data. */
    stalls: { type: ParameterType.INT },
    /** Time until the participant went on [s]. */
    rt: { type: ParameterType.FLOAT },
    ...WATCHED,
  },
} as const;

type Info = typeof info;

export default class FilmPlugin implements JsPsychPlugin<Info> {
  static info = info;

  constructor(private jsPsych: JsPsych) {}

  trial(display: HTMLElement, trial: TrialType<Info>): void {
    const words = trial.words as { [name: string]: string };
    const word = (name: string) => escaped(words[name] ?? "");
    display.innerHTML = `
      <div class="trial">
        <p class="progress">${word("progress")}</p>
        <h1>${word("title")}</h1>
        <video class="still" muted playsinline></video>
        <p class="hint" aria-live="polite"></p>
        <button class="jspsych-btn" type="button" disabled>${word("button")}</button>
      </div>`;
    (display.querySelector(".trial") as HTMLElement).style.setProperty("--aspect", String(trial.aspect));
    const video = display.querySelector("video") as HTMLVideoElement;
    const button = display.querySelector("button") as HTMLButtonElement;
    const watch = new Watch();
    const began = performance.now();
    let played = false;
    let stalls = 0;
    let over = false;

    const end = (how: boolean) => {
      if (over) return;
      over = true;
      played = how;
      clearTimeout(timer);
      button.disabled = false;
      button.focus();
      if (!how) (display.querySelector(".hint") as HTMLElement).textContent = words["unplayable"] ?? "";
    };
    let timer = setTimeout(() => end(false), trial.patience);
    const alive = () => {
      clearTimeout(timer);
      if (!over) timer = setTimeout(() => end(false), trial.patience);
    };
    video.setAttribute("aria-label", words["picture"] ?? "");
    video.muted = true;
    video.addEventListener("timeupdate", alive);
    video.addEventListener("waiting", () => (stalls += 1));
    video.addEventListener("ended", () => end(true));
    video.addEventListener("error", () => end(false));
    video.src = trial.stimulus;
    video.play().catch(() => end(false));
    button.addEventListener("click", () => {
      const seen = watch.stop();
      const quality = video.getVideoPlaybackQuality();
      this.jsPsych.finishTrial({
        played,
        stalls,
        rt: Math.round(performance.now() - began) / 1000,
        ...seen,
        dropped_frames: quality.droppedVideoFrames,
      });
    });
  }

  simulate(
    trial: TrialType<Info>,
    mode: string,
    _options: unknown,
    onLoad: () => void,
  ): void {
    onLoad();
    if (mode === "data-only") {
      this.jsPsych.finishTrial({ played: false, stalls: 0, rt: 0, ...new Watch().stop() });
      return;
    }
    const display = this.jsPsych.getDisplayElement();
    this.trial(display, trial);
    const button = display.querySelector("button") as HTMLButtonElement;
    const seen = new MutationObserver(() => {
      if (!button.disabled) button.click();
    });
    seen.observe(button, { attributes: true });
  }
}

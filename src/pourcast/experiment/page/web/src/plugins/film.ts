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
    /** The page's words: progress, title, picture, unplayable, blocked, play, button. */
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

/** A film that can't be started by so many presses is given up. */
const MOST_PRESSES = 2;

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
        <button class="jspsych-btn play" type="button" hidden disabled>${word("play")}</button>
        <button class="jspsych-btn onward" type="button" disabled>${word("button")}</button>
      </div>`;
    const find = (css: string) => display.querySelector(css) as HTMLElement;
    find(".trial").style.setProperty("--aspect", String(trial.aspect));
    const video = find("video") as HTMLVideoElement;
    const play = find(".play") as HTMLButtonElement;
    const button = find(".onward") as HTMLButtonElement;
    const hint = find(".hint");
    const watch = new Watch();
    const began = performance.now();
    let played = false;
    let stalls = 0;
    let presses = 0;
    let over = false;
    let timer: ReturnType<typeof setTimeout> | undefined;

    const offer = (shown: boolean) => {
      play.hidden = play.disabled = !shown;
      button.hidden = shown;
      hint.textContent = shown ? (words["blocked"] ?? "") : "";
    };
    const end = (how: boolean) => {
      if (over) return;
      over = true;
      played = how;
      clearTimeout(timer);
      offer(false);
      button.disabled = false;
      button.focus();
      if (!how) hint.textContent = words["unplayable"] ?? "";
    };
    // Pictures are only waited for while they should come.
    const alive = () => {
      clearTimeout(timer);
      if (!over && !document.hidden && play.hidden) timer = setTimeout(() => end(false), trial.patience);
    };
    /** The browser has stopped the film, or lets only a person start it: autoplay, low power. */
    const stopped = () => {
      if (over || video.ended || document.hidden) return;
      clearTimeout(timer);
      offer(true);
      play.focus();
    };
    const start = () => {
      offer(false);
      alive();
      video.play().catch((error: unknown) => {
        const name = error instanceof DOMException ? error.name : "";
        if (name === "AbortError" || (name === "NotAllowedError" && presses < MOST_PRESSES)) stopped();
        else end(false);
      });
    };
    /** A film that nobody can see waits: not all browsers stop it by themselves. */
    const turned = () => {
      clearTimeout(timer);
      if (over) return;
      if (document.hidden) video.pause();
      else if (play.hidden) start();
    };
    video.setAttribute("aria-label", words["picture"] ?? "");
    video.muted = true;
    video.addEventListener("timeupdate", alive);
    video.addEventListener("waiting", () => (stalls += 1));
    video.addEventListener("pause", stopped);
    video.addEventListener("ended", () => end(true));
    video.addEventListener("error", () => end(false));
    document.addEventListener("visibilitychange", turned);
    video.src = trial.stimulus;
    start();
    play.addEventListener("click", () => {
      presses += 1;
      start();
    });
    button.addEventListener("click", () => {
      document.removeEventListener("visibilitychange", turned);
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
    const button = display.querySelector(".onward") as HTMLButtonElement;
    const seen = new MutationObserver(() => {
      if (!button.disabled) button.click();
    });
    seen.observe(button, { attributes: true });
  }
}

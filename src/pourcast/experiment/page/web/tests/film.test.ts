/** A film is seen to its end, or given up: nobody is stuck in it. */
import type { JsPsych } from "jspsych";
import { beforeEach, describe, expect, it, vi } from "vitest";

import FilmPlugin from "../src/plugins/film";

type Trial = Parameters<FilmPlugin["trial"]>[1];
type Data = { [key: string]: unknown };

const WORDS = { progress: "", title: "Watch", picture: "A film", unplayable: "It can't be played.", button: "Go on" };

class Page {
  readonly display = document.createElement("div");
  readonly finished: Data[] = [];
  readonly video: HTMLVideoElement;
  readonly button: HTMLButtonElement;

  constructor() {
    document.body.replaceChildren(this.display);
    const jsPsych = { finishTrial: (data: Data) => this.finished.push(data) };
    const plugin = new FilmPlugin(jsPsych as unknown as JsPsych);
    const trial: Trial = { type: FilmPlugin, stimulus: "a.mp4", aspect: 2 / 3, words: WORDS, patience: 10_000 };
    plugin.trial(this.display, trial);
    this.video = this.display.querySelector("video") as HTMLVideoElement;
    this.button = this.display.querySelector("button") as HTMLButtonElement;
    this.video.getVideoPlaybackQuality = () => ({ droppedVideoFrames: 3 }) as VideoPlaybackQuality;
  }

  happens(...events: string[]): void {
    for (const event of events) this.video.dispatchEvent(new Event(event));
  }

  get hint(): string | null | undefined {
    return this.display.querySelector(".hint")?.textContent;
  }
}

beforeEach(() => {
  vi.useFakeTimers({ toFake: ["setTimeout", "clearTimeout", "performance"] });
  vi.spyOn(HTMLMediaElement.prototype, "play").mockResolvedValue(undefined);
});

describe("a film", () => {
  it("must be seen to its end before one goes on", () => {
    const page = new Page();
    expect(page.button.disabled).toBe(true);
    page.happens("timeupdate", "waiting", "timeupdate", "waiting", "ended");
    expect(page.button.disabled).toBe(false);
    expect(document.activeElement).toBe(page.button);
    page.button.click();
    expect(page.finished[0]).toMatchObject({ played: true, stalls: 2, dropped_frames: 3 });
    expect(page.hint).toBe("");
  });

  it("is given up when no picture comes for so long, and only then", async () => {
    const page = new Page();
    await vi.advanceTimersByTimeAsync(9000);
    page.happens("timeupdate");
    await vi.advanceTimersByTimeAsync(9000);
    expect(page.button.disabled).toBe(true);
    await vi.advanceTimersByTimeAsync(1000);
    expect(page.hint).toBe("It can't be played.");
    page.button.click();
    expect(page.finished[0]).toMatchObject({ played: false });
  });

  it("is given up at once when it can't be played", async () => {
    const broken = new Page();
    broken.happens("error");
    expect(broken.button.disabled).toBe(false);
    vi.spyOn(HTMLMediaElement.prototype, "play").mockRejectedValue(new DOMException("no", "NotAllowedError"));
    const forbidden = new Page();
    await vi.advanceTimersByTimeAsync(0);
    expect(forbidden.hint).toBe("It can't be played.");
  });

  it("that was seen stays seen, whatever comes after", async () => {
    const page = new Page();
    page.happens("ended", "error", "timeupdate");
    await vi.advanceTimersByTimeAsync(60_000);
    expect(page.hint).toBe("");
    page.button.click();
    expect(page.finished[0]).toMatchObject({ played: true });
  });

  it("has a name, and no sound", () => {
    const { video } = new Page();
    expect(video.getAttribute("aria-label")).toBe("A film");
    expect(video.muted).toBe(true);
  });
});

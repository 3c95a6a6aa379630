/** A film is seen to its end, or given up: nobody is stuck in it. */
import type { JsPsych } from "jspsych";
import { beforeEach, describe, expect, it, vi } from "vitest";

import FilmPlugin from "../src/plugins/film";

type Trial = Parameters<FilmPlugin["trial"]>[1];
type Data = { [key: string]: unknown };

const WORDS = { progress: "", title: "Watch", picture: "A film", unplayable: "It can't be played.", blocked: "Press.", play: "Play", button: "Go on" };

class Page {
  readonly display = document.createElement("div");
  readonly finished: Data[] = [];
  readonly video: HTMLVideoElement;
  readonly button: HTMLButtonElement;
  readonly play: HTMLButtonElement;

  constructor() {
    document.body.replaceChildren(this.display);
    const jsPsych = { finishTrial: (data: Data) => this.finished.push(data) };
    const plugin = new FilmPlugin(jsPsych as unknown as JsPsych);
    const trial: Trial = { type: FilmPlugin, stimulus: "a.mp4", aspect: 2 / 3, words: WORDS, patience: 10_000 };
    plugin.trial(this.display, trial);
    this.video = this.display.querySelector("video") as HTMLVideoElement;
    this.button = this.display.querySelector(".onward") as HTMLButtonElement;
    this.play = this.display.querySelector(".play") as HTMLButtonElement;
    this.video.getVideoPlaybackQuality = () => ({ droppedVideoFrames: 3 }) as VideoPlaybackQuality;
  }

  happens(...events: string[]): void {
    for (const event of events) this.video.dispatchEvent(new Event(event));
  }

  get hint(): string | null | undefined {
    return this.display.querySelector(".hint")?.textContent;
  }
}

/** How the browser takes each call of `play`: null plays; the last one stays. */
function plays(...how: (DOMException | null)[]) {
  const play = vi.spyOn(HTMLMediaElement.prototype, "play");
  for (const one of how.slice(0, -1)) {
    if (one) play.mockRejectedValueOnce(one);
    else play.mockResolvedValueOnce(undefined);
  }
  const last = how[how.length - 1];
  return last ? play.mockRejectedValue(last) : play.mockResolvedValue(undefined);
}

function hide(hidden: boolean): void {
  vi.spyOn(document, "hidden", "get").mockReturnValue(hidden);
  document.dispatchEvent(new Event("visibilitychange"));
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
    plays(new DOMException("no", "NotSupportedError"));
    const unknown = new Page();
    await vi.advanceTimersByTimeAsync(0);
    expect(unknown.hint).toBe("It can't be played.");
    expect(unknown.play.hidden).toBe(true);
  });

  it("that only a person may start has a button for it, and counts when it was seen", async () => {
    plays(new DOMException("no", "NotAllowedError"), null);
    const page = new Page();
    await vi.advanceTimersByTimeAsync(0);
    expect([page.play.hidden, page.button.hidden, page.hint]).toEqual([false, true, "Press."]);
    expect(document.activeElement).toBe(page.play);
    await vi.advanceTimersByTimeAsync(60_000); // however long that takes
    expect(page.play.hidden).toBe(false);
    page.play.click();
    expect([page.play.hidden, page.button.hidden, page.hint]).toEqual([true, false, ""]);
    expect(page.button.disabled).toBe(true);
    page.happens("timeupdate", "ended");
    page.button.click();
    expect(page.finished[0]).toMatchObject({ played: true });
  });

  it("that is refused after presses, too, is given up", async () => {
    plays(new DOMException("no", "NotAllowedError"));
    const page = new Page();
    for (let k = 0; k < 2; k += 1) {
      await vi.advanceTimersByTimeAsync(0);
      expect(page.button.disabled).toBe(true);
      page.play.click();
    }
    await vi.advanceTimersByTimeAsync(0);
    expect(page.hint).toBe("It can't be played.");
    expect(page.button.hidden).toBe(false);
    page.button.click();
    expect(page.finished[0]).toMatchObject({ played: false });
  });

  it("that no picture follows a press of is given up, too", async () => {
    plays(new DOMException("no", "NotAllowedError"), null);
    const page = new Page();
    await vi.advanceTimersByTimeAsync(0);
    page.play.click();
    await vi.advanceTimersByTimeAsync(10_000);
    expect(page.hint).toBe("It can't be played.");
  });

  it("that the browser stops can be gone on with", async () => {
    const page = new Page();
    page.happens("timeupdate", "pause");
    expect(page.play.hidden).toBe(false);
    await vi.advanceTimersByTimeAsync(60_000);
    page.play.click();
    page.happens("ended");
    expect(page.button.disabled).toBe(false);
  });

  it("waits while nobody can see it, and goes on by itself", async () => {
    const play = plays(null);
    const pause = vi.spyOn(HTMLMediaElement.prototype, "pause").mockReturnValue(undefined);
    const page = new Page();
    page.happens("timeupdate");
    hide(true);
    page.happens("pause");
    expect(pause).toHaveBeenCalledTimes(1);
    await vi.advanceTimersByTimeAsync(60_000);
    expect([page.hint, page.play.hidden, page.button.disabled]).toEqual(["", true, true]);
    hide(false);
    expect(play).toHaveBeenCalledTimes(2);
    page.happens("timeupdate", "ended");
    page.button.click();
    hide(true);
    expect(pause).toHaveBeenCalledTimes(1); // it has been left
  });

  it("that may not go on by itself after that has a button for it", async () => {
    plays(null, new DOMException("no", "NotAllowedError"));
    vi.spyOn(HTMLMediaElement.prototype, "pause").mockReturnValue(undefined);
    const page = new Page();
    hide(true);
    hide(false);
    await vi.advanceTimersByTimeAsync(0);
    expect(document.activeElement).toBe(page.play);
  });

  it("that is stopped while it begins has a button for it", async () => {
    plays(new DOMException("stopped", "AbortError"));
    const page = new Page();
    await vi.advanceTimersByTimeAsync(0);
    expect(page.play.hidden).toBe(false);
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

/** What disturbed a step is counted, each disturbance once. */
import { beforeEach, describe, expect, it, vi } from "vitest";

import { Watch } from "../src/watch";

/** Pictures that the screen shows, at times that a test names [ms]. */
let next: ((now: number) => void) | null = null;

function draw(...times: number[]): void {
  for (const now of times) next?.(now);
}

function hide(hidden: boolean): void {
  vi.spyOn(document, "hidden", "get").mockReturnValue(hidden);
  document.dispatchEvent(new Event("visibilitychange"));
}

beforeEach(() => {
  next = null;
  vi.stubGlobal("requestAnimationFrame", (callback: (now: number) => void) => {
    next = callback;
    return 1;
  });
  vi.stubGlobal("cancelAnimationFrame", () => (next = null));
});

describe("a watch", () => {
  it("counts a loss of focus once, though window and page both tell of it", () => {
    const watch = new Watch();
    window.dispatchEvent(new Event("blur"));
    hide(true);
    hide(false);
    window.dispatchEvent(new Event("focus"));
    window.dispatchEvent(new Event("blur"));
    expect(watch.stop().focus_losses).toBe(2);
  });

  it("counts pictures that came too late", () => {
    const watch = new Watch();
    draw(1000, 1016.7, 1033.3); // 60 a second
    draw(1083.3); // two are missing
    draw(1091.6, 1100); // a faster screen
    expect(watch.stop().dropped_frames).toBe(2);
  });

  it("counts none of a page that nobody could see", () => {
    const watch = new Watch();
    draw(1000, 1016.7);
    hide(true);
    hide(false);
    draw(60_000, 60_016.7);
    expect(watch.stop()).toMatchObject({ dropped_frames: 0, focus_losses: 1 });
  });

  it("counts nothing when it is stopped", () => {
    const watch = new Watch();
    watch.stop();
    expect(next).toBeNull();
    window.dispatchEvent(new Event("blur"));
    hide(true);
    const { focus_losses, window_width, window_height } = watch.stop();
    expect(focus_losses).toBe(0);
    expect([window_width, window_height]).toEqual([window.innerWidth, window.innerHeight]);
  });
});

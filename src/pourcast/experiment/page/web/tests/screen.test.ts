/** Full screen, also of old browsers; and pictures that are made to fit. */
import { beforeEach, describe, expect, it, vi } from "vitest";

const OLD = { webkitRequestFullscreen: () => undefined, webkitFullscreenElement: null as Element | null };

/** The browser's facilities of full screen, in place of all that this one has. */
function browser(page: object, root: object = {}): void {
  for (const name of ["fullscreenElement", "fullscreenEnabled", "webkitFullscreenElement", "webkitFullscreenEnabled"])
    Object.defineProperty(document, name, { value: undefined, configurable: true, writable: true });
  const element = document.documentElement;
  Object.defineProperty(element, "requestFullscreen", { value: undefined, configurable: true, writable: true });
  Object.assign(document, page);
  Object.assign(element, root);
}

beforeEach(() => {
  vi.resetModules();
  vi.useFakeTimers();
});

const screen = () => import("../src/screen");

describe("full screen", () => {
  it("is asked for, and told of when the window has its size", async () => {
    const { fillScreen, isFull } = await screen();
    browser({}, {
      requestFullscreen: () => {
        Object.assign(document, { fullscreenElement: document.documentElement });
        return Promise.resolve();
      },
    });
    let told = false;
    void fillScreen().then(() => (told = true));
    for (const width of [1000, 1100, 1200, 1366]) {
      Object.assign(window, { innerWidth: width });
      await vi.advanceTimersByTimeAsync(200);
      expect(told).toBe(false);
    }
    await vi.advanceTimersByTimeAsync(400);
    expect(told).toBe(true);
    expect(isFull()).toBe(true);
  });

  it("that is refused keeps nobody waiting", async () => {
    const { fillScreen, isFull } = await screen();
    browser({}, { requestFullscreen: () => Promise.reject(new TypeError("not allowed")) });
    const asked = fillScreen();
    await vi.advanceTimersByTimeAsync(3000);
    await asked;
    expect(isFull()).toBe(false);
  });

  it("of a window that never comes to rest keeps nobody waiting", async () => {
    const { fillScreen } = await screen();
    browser({}, { requestFullscreen: () => Promise.resolve() });
    let told = false;
    void fillScreen().then(() => (told = true));
    for (let k = 0; k < 61; k += 1) {
      Object.assign(window, { innerWidth: 1000 + k });
      await vi.advanceTimersByTimeAsync(50);
    }
    expect(told).toBe(true);
  });

  it("has other names in old browsers", async () => {
    const { canFill, fillScreen, isFull } = await screen();
    const request = vi.fn<() => void>(() => Object.assign(document, { webkitFullscreenElement: document.body }));
    browser({ ...OLD, webkitFullscreenEnabled: true }, { webkitRequestFullscreen: request });
    expect([canFill(), isFull()]).toEqual([true, false]);
    const asked = fillScreen();
    expect(request).toHaveBeenCalled(); // at once: a moment later it would be refused
    await vi.advanceTimersByTimeAsync(3000);
    await asked;
    expect(isFull()).toBe(true);
  });

  it("is not asked for where there is none, as on an iPhone", async () => {
    const { canFill } = await screen();
    browser({});
    expect(canFill()).toBe(false);
    browser({ fullscreenEnabled: false });
    expect(canFill()).toBe(false);
  });
});

describe("a picture", () => {
  it("is made smaller by what does not fit, and stays so", async () => {
    const { fitPicture } = await screen();
    const root = document.documentElement;
    const more = () => root.style.getPropertyValue("--more");
    const scroll = vi.spyOn(root, "scrollHeight", "get").mockReturnValue(625);
    vi.spyOn(root, "clientHeight", "get").mockReturnValue(585);
    fitPicture();
    expect(more()).toBe("40px");
    scroll.mockReturnValue(585);
    fitPicture();
    expect(more()).toBe("40px");
    scroll.mockReturnValue(590);
    fitPicture();
    expect(more()).toBe("45px");
    // Another window knows nothing of it.
    Object.assign(window, { innerHeight: 901 });
    scroll.mockReturnValue(585);
    fitPicture();
    expect(more()).toBe("0px");
  });
});

/** A judgment by a slider: with mouse, finger and keyboard, and what its record says. */
import * as fc from "fast-check";
import type { JsPsych } from "jspsych";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";

import SliderPlugin from "../src/plugins/slider";

type Trial = Parameters<SliderPlugin["trial"]>[1];
type Data = { [key: string]: unknown };

const LEFT = 100;
const WIDTH = 200;

const WORDS = {
  progress: "Trial 1 of 2",
  question: "How <much>?",
  picture: 'A "scene"',
  slider: "Share on the right",
  low: "left",
  high: "right",
  value: "left {rest} %, right {share} %",
  unset: "Move the mouse.",
  set: "Press ENTER.",
  button: "Hand in",
};

/** Two basins: what is judged is on the right. */
const ANSWER_PICTURE = {
  columns: [
    { x: 0, width: 0.5, judged: false, full: 1 },
    { x: 0.5, width: 0.5, judged: true, full: 0.5 },
  ],
  parts: [[[0.45, 0], [0.5, 0.75], [0.55, 0]]],
};

/** The page of one trial, and the hands of a participant. */
class Page {
  readonly display = document.createElement("div");
  readonly finished: Data[] = [];
  readonly plugin: SliderPlugin;
  readonly trial: Trial;

  constructor(changed: Partial<Trial> = {}) {
    document.body.replaceChildren(this.display);
    const jsPsych = {
      finishTrial: (data: Data) => {
        this.finished.push(data);
        this.display.replaceChildren();
      },
      getDisplayElement: () => this.display,
    };
    this.plugin = new SliderPlugin(jsPsych as unknown as JsPsych);
    this.trial = {
      type: SliderPlugin,
      stimulus: "a.png",
      aspect: 2 / 3,
      answer_picture: ANSWER_PICTURE,
      colour: "#2978cc",
      words: WORDS,
      start: "none",
      start_at: 0.5,
      mouse: "move",
      number: true,
      trajectory: false,
      ...changed,
    };
  }

  /** Shows the trial; the clock of its answer begins. */
  async show(): Promise<this> {
    void this.plugin.trial(this.display, this.trial, () => undefined);
    this.bar.getBoundingClientRect = () => new DOMRect(LEFT, 0, WIDTH, 40);
    await vi.advanceTimersByTimeAsync(50);
    return this;
  }

  static async shown(changed: Partial<Trial> = {}): Promise<Page> {
    return new Page(changed).show();
  }

  find(css: string): HTMLElement {
    const found = this.display.querySelector<HTMLElement>(css);
    if (!found) throw new Error(`${css} is not on the page`);
    return found;
  }

  get bar(): HTMLElement {
    return this.find(".slider");
  }

  get button(): HTMLButtonElement {
    return this.find("button") as HTMLButtonElement;
  }

  /** What the handle and the bar show, 0 to 100; null where there is no handle. */
  get place(): number | null {
    const handle = this.find(".handle");
    return handle.hidden ? null : Number.parseFloat(handle.style.left);
  }

  /** The pointer at a place of the bar, 0 to 1. */
  point(kind: "pointerdown" | "pointermove", place: number, changed: PointerEventInit = {}): void {
    const clientX = LEFT + place * WIDTH;
    const buttons = kind === "pointerdown" ? 1 : 0;
    const event = { pointerType: "mouse", buttons, clientX, clientY: 20, bubbles: true, ...changed };
    this.bar.dispatchEvent(new PointerEvent(kind, event));
  }

  press(key: string, changed: KeyboardEventInit = {}): KeyboardEvent {
    const event = new KeyboardEvent("keydown", { key, bubbles: true, cancelable: true, ...changed });
    document.dispatchEvent(event);
    return event;
  }

  /** ENTER, when it is heard; the data that were handed in, if any were. */
  async enter(): Promise<Data | undefined> {
    await vi.advanceTimersByTimeAsync(500);
    this.press("Enter");
    await vi.advanceTimersByTimeAsync(0);
    return this.finished[0];
  }
}

/** What a test has left open would hear the next one's keys. */
afterEach(async () => {
  await vi.advanceTimersByTimeAsync(500);
  for (const key of ["End", "Enter"])
    document.dispatchEvent(new KeyboardEvent("keydown", { key, cancelable: true }));
});

beforeEach(() => {
  vi.useFakeTimers({
    toFake: ["setTimeout", "clearTimeout", "requestAnimationFrame", "cancelAnimationFrame", "performance"],
  });
  vi.spyOn(HTMLImageElement.prototype, "decode").mockResolvedValue(undefined);
});

describe("before an answer is set", () => {
  it("there is no handle, the button is off and a hint says what to do", async () => {
    const page = await Page.shown();
    expect(page.place).toBeNull();
    expect(page.button.disabled).toBe(true);
    expect(page.find(".hint").textContent).toBe("Move the mouse.");
    expect(page.bar.hasAttribute("aria-valuenow")).toBe(false);
    expect(page.bar.getAttribute("aria-valuetext")).toBe("Move the mouse.");
  });

  it("neither ENTER nor a click hands anything in", async () => {
    const page = await Page.shown();
    expect(await page.enter()).toBeUndefined();
    page.button.dispatchEvent(new MouseEvent("click"));
    await vi.advanceTimersByTimeAsync(0);
    expect(page.finished).toEqual([]);
    page.press("ArrowRight");
    expect(await page.enter()).toBeDefined(); // The page still listens.
  });

  it("nothing counts before the picture is there", async () => {
    let there = vi.fn<() => void>();
    vi.spyOn(HTMLImageElement.prototype, "decode").mockReturnValue(
      new Promise((resolve) => (there = vi.fn<() => void>(resolve))),
    );
    const page = await Page.shown();
    page.press("ArrowRight");
    page.point("pointermove", 0.25);
    expect(page.place).toBeNull();
    there();
    await vi.advanceTimersByTimeAsync(50);
    page.point("pointermove", 0.25);
    expect(page.place).toBe(25);
  });

  it("a picture that can't be decoded stops nobody", async () => {
    vi.spyOn(HTMLImageElement.prototype, "decode").mockRejectedValue(new Error("EncodingError"));
    const page = await Page.shown();
    page.press("End");
    expect(await page.enter()).toMatchObject({ response: 1 });
  });
});

describe("the start of the handle", () => {
  it.each([
    ["none", null],
    ["centre", 0.5],
    ["fixed", 0.2],
  ])("%s", async (start, place) => {
    const page = await Page.shown({ start, start_at: 0.2 });
    expect(page.place).toBe(place === null ? null : 100 * place);
    expect(page.button.disabled).toBe(place === null);
    page.press("End");
    expect(await page.enter()).toMatchObject({ start: place, response: 1 });
  });

  it("random is anywhere, in whole percent, and said in the record", async () => {
    const draw = vi.spyOn(Math, "random");
    for (const [drawn, place] of [[0, 0], [0.4242, 42], [0.9999, 100]] as const) {
      draw.mockReturnValue(drawn);
      const page = await Page.shown({ start: "random" });
      expect(page.place).toBe(place);
      expect(await page.enter()).toMatchObject({ start: place / 100, response: place / 100 });
    }
  });

  it("is an answer that nobody moved, and the record says so", async () => {
    const page = await Page.shown({ start: "centre" });
    expect(await page.enter()).toMatchObject({ response: 0.5, moves: 0, first_move: null, input: "none" });
  });
});

describe("the mouse", () => {
  it("moves the handle without a button, where it moves", async () => {
    const page = await Page.shown({ mouse: "move" });
    page.point("pointermove", 0.25);
    expect(page.place).toBe(25);
    page.point("pointermove", 0.75);
    expect(page.place).toBe(75);
    expect(await page.enter()).toMatchObject({ response: 0.75, moves: 2, input: "mouse" });
  });

  it("needs a button where it drags", async () => {
    const page = await Page.shown({ mouse: "drag" });
    page.point("pointermove", 0.25);
    expect(page.place).toBeNull();
    page.point("pointerdown", 0.4);
    expect(page.place).toBe(40);
    page.point("pointermove", 0.6, { buttons: 1 });
    expect(page.place).toBe(60);
    page.point("pointermove", 0.9);
    expect(page.place).toBe(60);
    expect(await page.enter()).toMatchObject({ response: 0.6, moves: 2, input: "mouse" });
  });

  it("hands in by the button, once", async () => {
    const page = await Page.shown();
    page.point("pointerdown", 0.3);
    expect(page.button.disabled).toBe(false);
    const { button } = page;
    button.click();
    button.click();
    await vi.advanceTimersByTimeAsync(0);
    expect(page.finished).toHaveLength(1);
    expect(page.finished[0]).toMatchObject({ response: 0.3 });
  });

  it("keeps the handle on the bar", async () => {
    const page = await Page.shown();
    page.point("pointerdown", -3);
    expect(page.place).toBe(0);
    page.point("pointermove", 7);
    expect(page.place).toBe(100);
  });

  it("says nothing about a bar that has no width", async () => {
    const page = await Page.shown();
    page.bar.getBoundingClientRect = () => new DOMRect(LEFT, 0, 0, 0);
    page.point("pointermove", 0);
    page.point("pointermove", 0.5);
    expect(page.place).toBeNull();
    expect(await page.enter()).toBeUndefined();
  });
});

describe("a finger", () => {
  it.each(["touch", "pen"])("(%s) moves the handle while it touches, however the mouse is set", async (pointerType) => {
    for (const mouse of ["move", "drag"]) {
      const page = await Page.shown({ mouse });
      page.point("pointermove", 0.9, { pointerType });
      expect(page.place).toBeNull();
      page.point("pointerdown", 0.1, { pointerType });
      page.point("pointermove", 0.2, { pointerType, buttons: 1 });
      expect(page.place).toBe(20);
      expect(await page.enter()).toMatchObject({ response: 0.2, input: "touch" });
    }
  });
});

describe("the keyboard", () => {
  it.each([
    ["ArrowRight", {}, 0.51],
    ["ArrowUp", {}, 0.51],
    ["ArrowLeft", {}, 0.49],
    ["ArrowDown", {}, 0.49],
    ["ArrowRight", { shiftKey: true }, 0.6],
    ["ArrowLeft", { shiftKey: true }, 0.4],
    ["PageUp", {}, 0.6],
    ["PageDown", {}, 0.4],
    ["PageUp", { shiftKey: true }, 0.6],
    ["Home", {}, 0],
    ["End", {}, 1],
  ])("%s %j goes from the middle to %f", async (key, changed, place) => {
    const page = await Page.shown();
    expect(page.press(key, changed).defaultPrevented).toBe(true);
    expect(await page.enter()).toMatchObject({ response: place, input: "keyboard", start: null });
  });

  it("goes on from where the mouse was, in whole percent", async () => {
    const page = await Page.shown();
    page.point("pointermove", 0.2345);
    page.press("ArrowRight");
    expect(page.place).toBe(24);
  });

  it("stops at the ends", async () => {
    const page = await Page.shown({ start: "fixed", start_at: 0.99 });
    for (let k = 0; k < 3; k++) page.press("ArrowRight");
    expect(page.place).toBe(100);
    for (let k = 0; k < 12; k++) page.press("PageDown");
    expect(page.place).toBe(0);
  });

  it("leaves other keys, and the browser's shortcuts, to the browser", async () => {
    const page = await Page.shown();
    const alone = [page.press("a"), page.press("Tab"), page.press("5"), page.press("toString")];
    const shortcuts = [
      page.press("ArrowLeft", { altKey: true }),
      page.press("Home", { ctrlKey: true }),
      page.press("ArrowRight", { metaKey: true }),
    ];
    for (const event of [...alone, ...shortcuts]) expect(event.defaultPrevented).toBe(false);
    expect(page.place).toBeNull();
  });

  it("hands nothing in by a key that is still down from the trial before", async () => {
    const page = await Page.shown({ start: "centre" });
    page.press("Enter"); // Too early.
    await vi.advanceTimersByTimeAsync(1000);
    page.press("Enter", { repeat: true });
    await vi.advanceTimersByTimeAsync(0);
    expect(page.finished).toEqual([]);
    expect(await page.enter()).toBeDefined();
  });

  it("is heard no more when the answer is handed in", async () => {
    const page = await Page.shown({ start: "centre" });
    await page.enter();
    expect(page.press("ArrowRight").defaultPrevented).toBe(false);
    expect(page.press("Enter").defaultPrevented).toBe(false);
    const focus = vi.spyOn(HTMLElement.prototype, "focus");
    window.dispatchEvent(new Event("focus"));
    expect(focus).not.toHaveBeenCalled();
    expect(page.finished).toHaveLength(1);
  });
});

describe("those who can't see it", () => {
  it("hear of a slider from 0 to 100, its name, its value, and its picture", async () => {
    const page = await Page.shown();
    const { bar } = page;
    expect(bar.getAttribute("role")).toBe("slider");
    expect(bar.tabIndex).toBe(0);
    expect(bar.getAttribute("aria-label")).toBe("Share on the right");
    expect([bar.getAttribute("aria-valuemin"), bar.getAttribute("aria-valuemax")]).toEqual(["0", "100"]);
    expect(page.find("img").getAttribute("alt")).toBe('A "scene"');
    expect(document.activeElement).toBe(bar);
    page.point("pointermove", 0.256);
    expect(bar.getAttribute("aria-valuenow")).toBe("26");
    expect(bar.getAttribute("aria-valuetext")).toBe("left 74 %, right 26 %");
    expect(page.find(".hint").textContent).toBe("Press ENTER.");
  });

  it("have the focus on the slider again when they come back to the window", async () => {
    const page = await Page.shown();
    page.bar.blur();
    window.dispatchEvent(new Event("focus"));
    expect(document.activeElement).toBe(page.bar);
  });
});

describe("what is shown", () => {
  it("is the answer as a number, if that is wanted", async () => {
    for (const number of [true, false]) {
      const page = await Page.shown({ number });
      page.point("pointermove", 0.5);
      const shown = page.find(".shown").textContent.trim();
      expect(shown).toBe(number ? "left 50 %, right 50 %" : "");
      expect(page.display.querySelectorAll(".shown svg")).toHaveLength(1);
    }
  });

  it("are words as they stand, never as HTML", async () => {
    const evil = '<img src="x" onerror="alert(1)">';
    const words = Object.fromEntries(Object.keys(WORDS).map((name) => [name, evil]));
    const page = await Page.shown({ words });
    page.point("pointermove", 0.5);
    expect(page.display.querySelectorAll("img")).toHaveLength(1);
    expect(page.find("h1").textContent).toBe(evil);
    expect(page.find("img").getAttribute("alt")).toBe(evil);
    expect(page.find("img").hasAttribute("onerror")).toBe(false);
  });
});

describe("the record", () => {
  it("has times from the picture on, in seconds, and the way if that is wanted", async () => {
    await vi.advanceTimersByTimeAsync(5000); // What came before is no part of it.
    const page = await Page.shown({ trajectory: true });
    await vi.advanceTimersByTimeAsync(1000);
    page.point("pointermove", 0.25);
    await vi.advanceTimersByTimeAsync(500);
    page.point("pointermove", 0.5);
    const data = await page.enter();
    const [first, second] = (data?.["trajectory"] ?? []) as [number, number][];
    expect(first).toEqual([data?.["first_move"], 0.25]);
    expect(second?.[1]).toBe(0.5);
    expect((second?.[0] ?? 0) - (first?.[0] ?? 0)).toBeCloseTo(0.5, 3);
    expect(data?.["first_move"]).toBeGreaterThanOrEqual(1);
    expect(data?.["first_move"]).toBeLessThan(1.1);
    expect((data?.["rt"] as number) - (second?.[0] ?? 0)).toBeCloseTo(0.5, 3);
  });

  it("has no way if that isn't wanted, and what disturbed in any case", async () => {
    const page = await Page.shown();
    window.dispatchEvent(new Event("blur"));
    window.dispatchEvent(new Event("focus"));
    page.point("pointermove", 0.25);
    const data = await page.enter();
    expect(data).toMatchObject({
      trajectory: null,
      focus_losses: 1,
      window_width: window.innerWidth,
      window_height: window.innerHeight,
    });
  });

  it("doesn't grow for ever", async () => {
    const page = await Page.shown({ trajectory: true });
    for (let k = 0; k < 2500; k++) page.point("pointermove", (k % 100) / 100);
    const data = await page.enter();
    expect(data?.["moves"]).toBe(2500);
    expect(data?.["trajectory"]).toHaveLength(2000);
  });

  it("has all that the plugin declares, and nothing else", async () => {
    const page = await Page.shown();
    page.press("End");
    const data = await page.enter();
    expect(Object.keys(data ?? {}).toSorted()).toEqual(Object.keys(SliderPlugin.info.data).toSorted());
    const simulated = new Page();
    simulated.plugin.simulate(simulated.trial, "data-only", { data: { response: 0.3, rt: 2 } }, () => undefined);
    expect(Object.keys(simulated.finished[0] ?? {}).toSorted()).toEqual(Object.keys(data ?? {}).toSorted());
    expect(simulated.finished[0]).toMatchObject({ response: 0.3, rt: 2 });
  });

  it("has what the page shows, from 0 to 1, whatever was done", async () => {
    const keys = ["ArrowLeft", "ArrowRight", "PageUp", "PageDown", "Home", "End", "x"];
    const act = fc.oneof(
      fc.record({ key: fc.constantFrom(...keys), shiftKey: fc.boolean() }),
      fc.record({ pixel: fc.integer({ min: -2 * WIDTH, max: 3 * WIDTH }), down: fc.boolean() }),
    );
    await fc.assert(
      fc.asyncProperty(fc.array(act, { maxLength: 20 }), async (acts) => {
        const page = await Page.shown({ trajectory: true });
        for (const one of acts) {
          if ("key" in one) page.press(one.key, { shiftKey: one.shiftKey });
          else page.point(one.down ? "pointerdown" : "pointermove", one.pixel / WIDTH);
        }
        const { place } = page;
        const now = page.bar.getAttribute("aria-valuenow");
        const data = await page.enter();
        expect(data === undefined).toBe(place === null);
        if (!data || place === null) return;
        const response = data["response"] as number;
        expect(response).toBeGreaterThanOrEqual(0);
        expect(response).toBeLessThanOrEqual(1);
        expect(response).toBeCloseTo(place / 100, 4);
        expect(now).toBe(String(Math.round(place)));
        const way = data["trajectory"] as [number, number][];
        expect(way).toHaveLength(data["moves"] as number);
        expect(way.at(-1)?.[1]).toBeCloseTo(response, 4);
      }),
      { numRuns: 50 },
    );
  });

  it.each([
    ["Home", [56, 0]],
    ["End", [0, 28]],
  ])("is drawn as columns of liquid (%s)", async (key, heights) => {
    const page = await Page.shown({ colour: "#b8a11f" });
    const columns = () => [...page.display.querySelectorAll(".split .liquid")];
    expect(columns()).toHaveLength(0);
    page.press(key);
    expect(columns().map((column) => Number(column.getAttribute("height")))).toEqual(heights);
    expect(columns().map((column) => column.getAttribute("fill"))).toEqual(["#b8a11f", "#b8a11f"]);
    expect(page.display.querySelector(".split .goal")?.getAttribute("points")).toContain("80,14");
  });

  it("of a simulated participant who is watched has its response", async () => {
    const page = new Page();
    page.plugin.simulate(page.trial, "visual", { data: { response: 0.3, rt: 1 } }, () => {
      page.bar.getBoundingClientRect = () => new DOMRect(LEFT, 0, WIDTH, 40);
    });
    await vi.advanceTimersByTimeAsync(3000);
    expect(page.finished).toHaveLength(1);
    expect(page.finished[0]).toMatchObject({ response: 0.3, input: "mouse" });
  });
});

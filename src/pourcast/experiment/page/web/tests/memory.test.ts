/** A reload finds what was remembered, whatever the browser does with its storage. */
import { beforeEach, describe, expect, it, vi } from "vitest";

import { drawn, makeWord } from "../src/draws";
import { forget, recall, remember } from "../src/memory";

function fails(name: string): () => never {
  return () => {
    throw new DOMException("No.", name);
  };
}

const STORAGES: { [kind: string]: () => void } = {
  "keeps it": () => undefined,
  "denies it": () => {
    const no = fails("SecurityError");
    vi.stubGlobal("localStorage", { getItem: no, setItem: no, removeItem: no });
  },
  "has no room": () => {
    vi.spyOn(Storage.prototype, "setItem").mockImplementation(fails("QuotaExceededError"));
  },
  "has none": () => vi.stubGlobal("localStorage", undefined),
};

describe.each(Object.keys(STORAGES))("a browser whose storage %s", (kind) => {
  beforeEach(() => {
    history.replaceState({ another: "component's" }, "");
    STORAGES[kind]?.();
  });

  it("remembers the last that was said, each under its name, and forgets it", () => {
    expect(recall("a")).toBeUndefined();
    remember("a", { x: 1 });
    remember("b", { x: 2 });
    remember("a", { x: 3 });
    expect(recall("a")).toEqual({ x: 3 });
    forget("a");
    expect(recall("a")).toBeUndefined();
    expect(recall("b")).toEqual({ x: 2 });
    expect(history.state).toMatchObject({ another: "component's" });
  });
});

describe("a memory", () => {
  it("has the newer where the storage was full for a while, before and after", () => {
    remember("a", { x: 1 });
    const full = vi.spyOn(Storage.prototype, "setItem").mockImplementation(fails("QuotaExceededError"));
    remember("a", { x: 2 });
    expect(recall("a")).toEqual({ x: 2 });
    full.mockRestore();
    remember("a", { x: 3 });
    expect(recall("a")).toEqual({ x: 3 });
  });

  it("takes what can't be read for nothing", () => {
    localStorage.setItem("a", "{half");
    expect(recall("a")).toBeUndefined();
  });

  it("costs a reload's memory, and no more, where the history is full, too", () => {
    STORAGES["denies it"]?.();
    vi.spyOn(history, "replaceState").mockImplementation(fails("SecurityError"));
    remember("a", { x: 1 });
    forget("a");
    expect(recall("a")).toBeUndefined();
  });
});

describe.each(["there", "missing"])("draws, with the browser's source %s", (source) => {
  beforeEach(() => {
    if (source === "missing") vi.stubGlobal("crypto", undefined);
  });

  it("are words of 32 letters, each another", () => {
    const words = Array.from({ length: 200 }, makeWord);
    for (const word of words) expect(word).toMatch(/^[0-9a-f]{32}$/);
    expect(new Set(words).size).toBe(200);
  });

  it("are whole numbers from all of the range", () => {
    const numbers = drawn(2000);
    expect(numbers.every((one) => Number.isInteger(one) && one >= 0 && one < 2 ** 32)).toBe(true);
    expect(Math.min(...numbers)).toBeLessThan(2 ** 28);
    expect(Math.max(...numbers)).toBeGreaterThan(15 * 2 ** 28);
  });
});

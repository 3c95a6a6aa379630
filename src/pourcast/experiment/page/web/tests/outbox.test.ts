/** What was answered is neither lost nor doubled, whatever becomes of the browser's database. */
import * as fc from "fast-check";
import { IDBFactory, IDBObjectStore, IDBOpenDBRequest, IDBRequest } from "fake-indexeddb";
import { describe, expect, it, vi } from "vitest";

import { Outbox, type Entry } from "../src/outbox";

/** What an entry says, without whether it is saved. */
function said(entries: Entry[]): [string, number, unknown][] {
  return entries.map(({ session, seq, body }) => [session, seq, body["x"]]);
}

describe("an outbox", () => {
  it("keeps a record until it is acknowledged", async () => {
    const outbox = await Outbox.open();
    await outbox.put("s", 0, { x: 1 });
    await outbox.put("s", 1, { x: 2 });
    const [first] = outbox.unsaved();
    await outbox.markSaved(first as Entry);
    expect(said(outbox.unsaved())).toEqual([["s", 1, 2]]);
    expect(said(outbox.of("s"))).toEqual([["s", 0, 1], ["s", 1, 2]]);
  });

  it("has a record on the disk when put() resolves", async () => {
    const outbox = await Outbox.open();
    await outbox.put("s", 3, { x: 1 });
    expect(said((await Outbox.open()).unsaved())).toEqual([["s", 3, 1]]);
  });

  it("knows after a reload what was acknowledged, and what was not", async () => {
    const before = await Outbox.open();
    await before.put("s", 0, { x: 1 });
    await before.put("s", 1, { x: 2 });
    await before.markSaved(before.of("s")[0] as Entry);
    const after = await Outbox.open();
    expect(said(after.unsaved())).toEqual([["s", 1, 2]]);
    expect(said(after.of("s"))).toEqual([["s", 0, 1], ["s", 1, 2]]);
  });

  it("keeps the first record of a step", async () => {
    const outbox = await Outbox.open();
    await outbox.put("s", 0, { x: "first" });
    await outbox.put("s", 0, { x: "second" });
    expect(said(outbox.unsaved())).toEqual([["s", 0, "first"]]);
    expect(said((await Outbox.open()).unsaved())).toEqual([["s", 0, "first"]]);
  });

  it("keeps the first record of a step when two come at once", async () => {
    const outbox = await Outbox.open();
    await Promise.all([outbox.put("s", 0, { x: "first" }), outbox.put("s", 0, { x: "second" })]);
    expect(said(outbox.unsaved())).toEqual([["s", 0, "first"]]);
    expect(said((await Outbox.open()).unsaved())).toEqual([["s", 0, "first"]]);
  });

  it("orders by number, not by text", async () => {
    const outbox = await Outbox.open();
    for (const seq of [10, 9, 100, 1]) await outbox.put("s", seq, { x: seq });
    expect(outbox.unsaved().map((entry) => entry.seq)).toEqual([1, 9, 10, 100]);
    expect(outbox.of("s").map((entry) => entry.seq)).toEqual([1, 9, 10, 100]);
  });

  it("sends again what the server says it lacks, and nothing else", async () => {
    const outbox = await Outbox.open();
    for (const seq of [0, 1, 2]) {
      await outbox.put("s", seq, { x: seq });
      await outbox.markSaved(outbox.of("s")[seq] as Entry);
    }
    outbox.markUnsaved("s", [1, 7]);
    outbox.markUnsaved("another", [0]);
    expect(said(outbox.unsaved())).toEqual([["s", 1, 1]]);
  });

  it("forgets a session for good, and no other", async () => {
    const outbox = await Outbox.open();
    await outbox.put("s", 0, { x: 1 });
    await outbox.put("another", 0, { x: 2 });
    await outbox.forget("s");
    expect(outbox.of("s")).toEqual([]);
    expect(said((await Outbox.open()).unsaved())).toEqual([["another", 0, 2]]);
  });
});

describe("two tabs", () => {
  it("see each other's records once they look", async () => {
    const [one, other] = [await Outbox.open(), await Outbox.open()];
    await one.put("s", 0, { x: 1 });
    expect(other.of("s")).toEqual([]);
    await other.refresh();
    expect(said(other.of("s"))).toEqual([["s", 0, 1]]);
  });

  it("don't write over one another's record of a step", async () => {
    const [one, other] = [await Outbox.open(), await Outbox.open()];
    await one.put("s", 0, { x: "one" });
    await other.put("s", 0, { x: "other" });
    expect(said((await Outbox.open()).unsaved())).toEqual([["s", 0, "one"]]);
    expect(said(other.unsaved())).toEqual([["s", 0, "one"]]);
  });

  it("don't call the other's record saved when they haven't posted it", async () => {
    const [one, other] = [await Outbox.open(), await Outbox.open()];
    await one.put("s", 0, { x: "one" });
    await Promise.all([
      other.put("s", 0, { x: "other" }),
      ...other.unsaved().map((entry) => other.markSaved(entry)),
    ]);
    expect(said((await Outbox.open()).unsaved())).toEqual([["s", 0, "one"]]);
  });

  it("keep their own unsaved record when they look at the disk", async () => {
    const [one, other] = [await Outbox.open(), await Outbox.open()];
    await one.put("s", 0, { x: 1 });
    await one.markSaved(one.of("s")[0] as Entry);
    await other.put("s", 1, { x: 2 });
    await other.refresh();
    expect(said(other.unsaved())).toEqual([["s", 1, 2]]);
  });
});

describe("a browser whose database fails", () => {
  async function worksInMemory(outbox: Outbox): Promise<void> {
    await outbox.put("s", 1, { x: 2 });
    await outbox.put("s", 0, { x: 1 });
    await outbox.put("s", 0, { x: "second" });
    expect(said(outbox.unsaved())).toEqual([["s", 0, 1], ["s", 1, 2]]);
    await outbox.markSaved(outbox.unsaved()[0] as Entry);
    await outbox.refresh();
    expect(said(outbox.unsaved())).toEqual([["s", 1, 2]]);
    await outbox.forget("s");
    expect(outbox.of("s")).toEqual([]);
  }

  /** A request that is never answered. */
  const silent = () => new IDBRequest() as never;

  it("has none", async () => {
    vi.stubGlobal("indexedDB", undefined);
    await worksInMemory(await Outbox.open());
  });

  it("refuses to open it, as private windows do", async () => {
    vi.spyOn(IDBFactory.prototype, "open").mockImplementation(() => {
      throw new DOMException("A mutation operation was attempted", "InvalidStateError");
    });
    await worksInMemory(await Outbox.open());
  });

  it("forbids its use, as where cookies are blocked", async () => {
    const forbidden = { get: () => { throw new DOMException("denied", "SecurityError"); } };
    const was = Object.getOwnPropertyDescriptor(globalThis, "indexedDB");
    Object.defineProperty(globalThis, "indexedDB", { ...forbidden, configurable: true });
    try {
      await worksInMemory(await Outbox.open());
    } finally {
      Object.defineProperty(globalThis, "indexedDB", was as PropertyDescriptor);
    }
  });

  it("can't read it", async () => {
    vi.spyOn(IDBObjectStore.prototype, "getAll").mockImplementation(() => {
      throw new DOMException("corrupt", "UnknownError");
    });
    await worksInMemory(await Outbox.open());
  });

  it("never answers when it is opened, as Safari 14 on its first page", async () => {
    vi.useFakeTimers({ toFake: ["setTimeout", "clearTimeout"] });
    vi.spyOn(IDBFactory.prototype, "open").mockImplementation(() => new IDBOpenDBRequest());
    const opening = Outbox.open();
    await vi.advanceTimersByTimeAsync(5000);
    const outbox = await opening;
    expect(outbox.survives).toBe(false);
    await worksInMemory(outbox);
  });

  it("never answers when it is read", async () => {
    vi.useFakeTimers({ toFake: ["setTimeout", "clearTimeout"] });
    vi.spyOn(IDBObjectStore.prototype, "getAll").mockImplementation(silent);
    const opening = Outbox.open();
    await vi.waitFor(() => expect(vi.getTimerCount()).toBe(1));
    await vi.advanceTimersByTimeAsync(5000);
    await worksInMemory(await opening);
  });

  it("never answers when it is written: it is waited for once", async () => {
    const outbox = await Outbox.open();
    expect(outbox.survives).toBe(true);
    vi.useFakeTimers({ toFake: ["setTimeout", "clearTimeout"] });
    for (const name of ["get", "add", "put", "delete"] as const)
      vi.spyOn(IDBObjectStore.prototype, name).mockImplementation(silent);
    const first = outbox.put("s", 1, { x: 2 });
    await vi.advanceTimersByTimeAsync(5000);
    await first;
    expect(outbox.survives).toBe(false);
    vi.useRealTimers();
    await worksInMemory(outbox);
  });

  it("has a full disk", async () => {
    const outbox = await Outbox.open();
    await outbox.put("another", 9, { x: 9 });
    const full = () => {
      throw new DOMException("full", "QuotaExceededError");
    };
    vi.spyOn(IDBObjectStore.prototype, "put").mockImplementation(full);
    vi.spyOn(IDBObjectStore.prototype, "add").mockImplementation(full);
    await outbox.markSaved(outbox.unsaved()[0] as Entry);
    await worksInMemory(outbox);
    expect(outbox.survives).toBe(false);
  });

  it("has a full disk for a while: the first record of a step stays all the same", async () => {
    const outbox = await Outbox.open();
    const full = vi.spyOn(IDBObjectStore.prototype, "add").mockImplementation(() => {
      throw new DOMException("full", "QuotaExceededError");
    });
    await Promise.all([outbox.put("s", 0, { x: "first" }), outbox.put("s", 0, { x: "second" })]);
    full.mockRestore();
    await outbox.put("s", 0, { x: "third" });
    expect(said(outbox.unsaved())).toEqual([["s", 0, "first"]]);
    expect(said((await Outbox.open()).unsaved())).toEqual([]);
  });

  it("closes it while the page is open", async () => {
    const outbox = await Outbox.open();
    await outbox.put("s", 0, { x: 1 });
    // The browser does so when somebody deletes the site's data.
    const { database } = outbox as unknown as { database: IDBDatabase };
    database.close();
    await outbox.put("s", 1, { x: 2 });
    await outbox.markSaved(outbox.unsaved()[0] as Entry);
    expect(said(outbox.unsaved())).toEqual([["s", 1, 2]]);
    await outbox.forget("s");
    expect(outbox.of("s")).toEqual([]);
  });
});

describe("whatever happens in whatever order", () => {
  const act = fc.record({
    does: fc.constantFrom("put", "put", "save", "refresh", "reload", "lack"),
    tab: fc.nat({ max: 1 }),
    seq: fc.nat({ max: 4 }),
  });

  it("the disk has the first record of each step until it was posted", async () => {
    await fc.assert(
      fc.asyncProperty(fc.array(act, { maxLength: 25 }), async (acts) => {
        globalThis.indexedDB = new IDBFactory();
        const tabs = [await Outbox.open(), await Outbox.open()];
        const first = new Map<number, number>();
        const posted = new Set<number>();
        for (const [x, { does, tab, seq }] of acts.entries()) {
          const outbox = tabs[tab] as Outbox;
          const own = outbox.of("s").find((entry) => entry.seq === seq);
          if (does === "put") {
            await outbox.put("s", seq, { x });
            if (!first.has(seq)) first.set(seq, x);
          } else if (does === "save" && own) {
            await outbox.markSaved(own);
            posted.add(seq);
          } else if (does === "refresh") await outbox.refresh();
          else if (does === "reload") tabs[tab] = await Outbox.open();
          else if (does === "lack") outbox.markUnsaved("s", [seq]);
        }
        const disk = await Outbox.open();
        const expected = [...first].toSorted(([a], [b]) => a - b);
        expect(disk.of("s").map((entry) => [entry.seq, entry.body["x"]])).toEqual(expected);
        const waiting = new Set(disk.unsaved().map((entry) => entry.seq));
        for (const [seq] of expected) expect(waiting.has(seq)).toBe(!posted.has(seq));
      }),
      { numRuns: 150 },
    );
  });
});

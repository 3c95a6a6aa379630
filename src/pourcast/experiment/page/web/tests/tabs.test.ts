/** One tab has the study: a second one is told, and whoever took it last keeps it. */
import * as fc from "fast-check";
import { beforeEach, describe, expect, it, vi } from "vitest";

import { Tabs } from "../src/tabs";

/** Messages between tabs, which a test delivers when it likes, each channel's own in order. */
class Channel extends EventTarget {
  static all: Channel[] = [];
  private waiting: unknown[] = [];

  constructor(readonly name: string) {
    super();
    Channel.all.push(this);
  }

  postMessage(message: unknown): void {
    for (const other of Channel.all)
      if (other !== this && other.name === this.name) other.waiting.push(structuredClone(message));
  }

  /** Whether there was a message. */
  deliver(): boolean {
    if (!this.waiting.length) return false;
    this.dispatchEvent(new MessageEvent("message", { data: this.waiting.shift() }));
    return true;
  }

  lose(): void {
    this.waiting = [];
  }

  static deliverAll(): void {
    while (Channel.all.some((channel) => channel.deliver()));
  }
}

interface Tab {
  tabs: Tabs;
  channel: Channel;
  taken: ReturnType<typeof vi.fn<() => void>>;
}

function tabOf(name: string, key = "study"): Tab {
  const tabs = new Tabs(name, key);
  const taken = vi.fn<() => void>();
  tabs.onTaken = taken;
  return { tabs, channel: Channel.all.at(-1) as Channel, taken };
}

/** Whether a tab is told that another has the study, once all messages are there. */
async function seesAnother(tab: Tab): Promise<boolean> {
  const elsewhere = tab.tabs.elsewhere();
  Channel.deliverAll();
  await vi.runAllTimersAsync();
  return elsewhere;
}

beforeEach(() => {
  Channel.all = [];
  vi.stubGlobal("BroadcastChannel", Channel);
  vi.useFakeTimers({ toFake: ["setTimeout", "clearTimeout", "Date"], now: 0 });
});

describe("a second tab", () => {
  it("is told of the first", async () => {
    tabOf("a").tabs.take();
    expect(await seesAnother(tabOf("b"))).toBe(true);
  });

  it("is told at once, and needn't wait", async () => {
    tabOf("a").tabs.take();
    const elsewhere = tabOf("b").tabs.elsewhere();
    Channel.deliverAll();
    expect(await elsewhere).toBe(true);
    expect(vi.getTimerCount()).toBe(0);
  });

  it("isn't told of one that has not begun, or has ended", async () => {
    const first = tabOf("a");
    expect(await seesAnother(tabOf("b"))).toBe(false);
    first.tabs.take();
    first.tabs.release();
    expect(await seesAnother(tabOf("c"))).toBe(false);
  });

  it("isn't told of another study, or of somebody else's session", async () => {
    tabOf("a", "another study").tabs.take();
    expect(await seesAnother(tabOf("b"))).toBe(false);
  });

  it("waits less than half a second for an answer that doesn't come", async () => {
    const first = tabOf("a");
    first.tabs.take();
    const elsewhere = tabOf("b").tabs.elsewhere();
    first.channel.lose();
    await vi.advanceTimersByTimeAsync(500);
    expect(await elsewhere).toBe(false);
  });

  it("takes over, and the first is told once", () => {
    const [first, second] = [tabOf("a"), tabOf("b")];
    first.tabs.take();
    Channel.deliverAll();
    vi.advanceTimersByTime(1000);
    second.tabs.take();
    Channel.deliverAll();
    expect(first.taken).toHaveBeenCalledOnce();
    expect(second.taken).not.toHaveBeenCalled();
  });

  it("is the only one that has it then", async () => {
    const [first, second, third] = [tabOf("a"), tabOf("b"), tabOf("c")];
    for (const { tabs } of [first, second, third]) {
      tabs.take();
      vi.advanceTimersByTime(1000);
      Channel.deliverAll();
    }
    expect(first.taken).toHaveBeenCalledOnce();
    third.tabs.release();
    expect(await seesAnother(tabOf("d"))).toBe(false);
  });

  it("takes nothing over from a tab that has ended", () => {
    const [first, second] = [tabOf("a"), tabOf("b")];
    first.tabs.take();
    first.tabs.release();
    second.tabs.take();
    Channel.deliverAll();
    expect(first.taken).not.toHaveBeenCalled();
  });

  it("can be left for the first again", async () => {
    const [first, second] = [tabOf("a"), tabOf("b")];
    for (const { tabs } of [first, second, first]) {
      tabs.take();
      vi.advanceTimersByTime(1000);
      Channel.deliverAll();
    }
    expect(first.taken).toHaveBeenCalledOnce();
    expect(second.taken).toHaveBeenCalledOnce();
    expect(await seesAnother(tabOf("c"))).toBe(true);
  });
});

describe("a message", () => {
  it("that was held back takes nothing from whoever took over since", () => {
    const [first, second] = [tabOf("a"), tabOf("b")];
    first.tabs.take();
    vi.advanceTimersByTime(1000);
    second.tabs.take(); // The first, asleep in the background, hears of it only later ...
    vi.advanceTimersByTime(1000);
    first.tabs.take(); // ... when it has the study again.
    Channel.deliverAll();
    expect(first.taken).not.toHaveBeenCalled();
    expect(second.taken).toHaveBeenCalledOnce();
  });

  it("of the same tab is no other's", () => {
    const [first, same] = [tabOf("a"), tabOf("a")];
    first.tabs.take();
    vi.advanceTimersByTime(1000);
    same.tabs.take();
    Channel.deliverAll();
    expect(first.taken).not.toHaveBeenCalled();
  });
});

describe("whatever the order of messages", () => {
  const act = fc.record({
    does: fc.constantFrom("take", "deliver", "deliver", "pass time"),
    tab: fc.nat({ max: 2 }),
  });

  it("one tab has the study in the end, the one that took it last", async () => {
    await fc.assert(
      fc.asyncProperty(fc.array(act, { maxLength: 30 }), async (acts) => {
        Channel.all = [];
        const all = ["a", "b", "c"].map((name) => tabOf(name));
        const holds = [false, false, false];
        for (const [k, { tabs }] of all.entries()) tabs.onTaken = () => (holds[k] = false);
        const took: { tab: number; at: number }[] = [];
        for (const { does, tab } of acts) {
          if (does === "pass time") vi.advanceTimersByTime(1000);
          else if (does === "deliver") all[tab]?.channel.deliver();
          else {
            all[tab]?.tabs.take();
            holds[tab] = true;
            took.push({ tab, at: Date.now() });
          }
        }
        Channel.deliverAll();
        const last = took.at(-1);
        const latest = took.filter(({ at }) => at === last?.at).map(({ tab }) => tab);
        const holding = holds.flatMap((held, k) => (held ? [k] : []));
        expect(holding).toHaveLength(last ? 1 : 0);
        for (const tab of holding) expect(latest).toContain(tab);
      }),
      { numRuns: 300 },
    );
  });
});

describe("a browser without channels", () => {
  const alone = async (tabs: Tabs) => {
    tabs.take();
    const elsewhere = tabs.elsewhere();
    await vi.runAllTimersAsync();
    return !(await elsewhere);
  };

  function withoutChannels(): void {
    vi.stubGlobal("BroadcastChannel", undefined);
    // @ts-expect-error: a browser that never heard of it
    delete globalThis.BroadcastChannel;
  }

  /** Other tabs are told of what is stored; here they share a window. */
  function tellOfStorage(): void {
    const set = localStorage.setItem.bind(localStorage);
    const was = new Map<string, string>();
    vi.stubGlobal("localStorage", {
      getItem: localStorage.getItem.bind(localStorage),
      setItem: (key: string, newValue: string) => {
        set(key, newValue);
        if (was.get(key) !== newValue) window.dispatchEvent(new StorageEvent("storage", { key, newValue }));
        was.set(key, newValue);
      },
      removeItem: (key: string) => {
        was.delete(key);
        window.dispatchEvent(new StorageEvent("storage", { key, newValue: null }));
      },
    });
  }

  it("has one tab only, as far as the page knows, where it stores nothing either", async () => {
    withoutChannels();
    vi.stubGlobal("localStorage", undefined);
    expect(await alone(new Tabs("a", "study"))).toBe(true);
  });

  it("tells two tabs by what it stores, as often as they ask", async () => {
    withoutChannels();
    tellOfStorage();
    const first = new Tabs("a", "study");
    first.onTaken = vi.fn<() => void>();
    expect(await alone(first)).toBe(true);
    const second = new Tabs("b", "study");
    expect(await second.elsewhere()).toBe(true);
    expect(await second.elsewhere()).toBe(true);
    vi.advanceTimersByTime(1000);
    second.take();
    expect(first.onTaken).toHaveBeenCalledOnce();
  });

  it("or that forbids them, as Firefox does where cookies are blocked, still shows the page", async () => {
    const forbidden = vi.fn<() => void>(function () {
      throw new DOMException("The operation is insecure.", "SecurityError");
    });
    vi.stubGlobal("BroadcastChannel", forbidden);
    expect(await alone(new Tabs("a", "study"))).toBe(true);
    expect(forbidden).toHaveBeenCalledOnce();
  });
});

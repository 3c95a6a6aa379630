/** Every record gets to the server once, in order, whatever the network does meanwhile. */
import * as fc from "fast-check";
import { beforeEach, describe, expect, it, vi } from "vitest";

import { Outbox } from "../src/outbox";
import { Sender } from "../src/sender";
import { Refused, type Transport } from "../src/transports/transport";
import type { Body } from "../src/types";

type Save = Transport["save"];

/** A server of which a test says what becomes of each request. */
class Server {
  /** What was posted, as it came. */
  posted: { session: string; seq: number; body: Body; tab: string; at: number }[] = [];
  /** What is on its disk. */
  kept: string[] = [];
  underWay = 0;
  most = 0;

  constructor(private answer: (nth: number, keep: () => void) => Promise<{ superseded: boolean }>) {}

  save: Save = async (session, seq, body, tab) => {
    this.posted.push({ session, seq, body, tab, at: Date.now() });
    this.most = Math.max(this.most, ++this.underWay);
    const key = `${session} ${seq} ${JSON.stringify(body)}`;
    const keep = () => {
      if (!this.kept.includes(key)) this.kept.push(key);
    };
    try {
      return await this.answer(this.posted.length - 1, keep);
    } finally {
      this.underWay -= 1;
    }
  };

  get numbers(): number[] {
    return this.posted.map(({ seq }) => seq);
  }
}

const fine = async (_: number, keep: () => void) => {
  keep();
  return { superseded: false };
};

function senderOf(outbox: Outbox, server: Server): Sender {
  return new Sender(outbox, { save: server.save } as Transport, "tab");
}

async function memoryWith(...numbers: number[]): Promise<Outbox> {
  vi.stubGlobal("indexedDB", undefined);
  const outbox = await Outbox.open();
  for (const seq of numbers) await outbox.put("s", seq, { x: seq });
  return outbox;
}

beforeEach(() => {
  // fake-indexeddb runs on setImmediate, which goes on.
  vi.useFakeTimers({ toFake: ["setTimeout", "clearTimeout", "Date"], now: 0 });
});

describe("a sender", () => {
  it("posts what waits in order, one after another, once", async () => {
    const outbox = await memoryWith(2, 0, 10, 1);
    const server = new Server(async (_, keep) => {
      await new Promise((resolve) => setTimeout(resolve, 20));
      return fine(_, keep);
    });
    const sender = senderOf(outbox, server);
    sender.start();
    sender.start();
    await vi.runAllTimersAsync();
    expect(server.numbers).toEqual([0, 1, 2, 10]);
    expect(server.posted[3]).toMatchObject({ session: "s", body: { x: 10 }, tab: "tab" });
    expect(server.most).toBe(1);
    expect(outbox.unsaved()).toEqual([]);
  });

  it("posts what comes while it is at work", async () => {
    const outbox = await memoryWith(0);
    const server = new Server(async (nth, keep) => {
      if (nth === 0) await outbox.put("s", 1, { x: 1 });
      return fine(nth, keep);
    });
    await senderOf(outbox, server).flushed();
    expect(server.numbers).toEqual([0, 1]);
  });

  it("can be started again when it was done", async () => {
    const outbox = await memoryWith(0);
    const server = new Server(fine);
    const sender = senderOf(outbox, server);
    await sender.flushed();
    await outbox.put("s", 1, { x: 1 });
    await sender.flushed();
    expect(server.numbers).toEqual([0, 1]);
  });

  it("says that all is sent only when it is", async () => {
    const outbox = await memoryWith(0, 1);
    const server = new Server(async (nth, keep) => {
      if (nth < 2) throw new TypeError("Failed to fetch");
      return fine(nth, keep);
    });
    const sender = senderOf(outbox, server);
    let over = false;
    const flushed = Promise.all([sender.flushed(), sender.flushed()]).then(() => (over = true));
    await vi.advanceTimersByTimeAsync(400);
    expect(over).toBe(false);
    await vi.runAllTimersAsync();
    await flushed;
    expect(server.kept).toHaveLength(2);
    await sender.flushed(); // With nothing to send it is over at once.
  });

  it("sends after a reload what it could not send before, and only that", async () => {
    const before = await Outbox.open();
    await before.put("s", 0, { x: 0 });
    await before.put("s", 1, { x: 1 });
    const server = new Server(async (nth, keep) => {
      if (nth === 1) return new Promise(() => undefined); // The page is closed while it waits.
      return fine(nth, keep);
    });
    senderOf(before, server).start();
    await vi.waitFor(() => expect(server.numbers).toEqual([0, 1]));
    await senderOf(await Outbox.open(), server).flushed();
    expect(server.numbers).toEqual([0, 1, 1]);
    expect(server.kept).toHaveLength(2);
    expect((await Outbox.open()).unsaved()).toEqual([]);
  });

  it("tells whose session another tab has, and sends the rest all the same", async () => {
    const outbox = await memoryWith(0, 1);
    const server = new Server(async (nth, keep) => ({ ...(await fine(nth, keep)), superseded: nth === 0 }));
    const sender = senderOf(outbox, server);
    sender.onSuperseded = vi.fn<(session: string) => void>();
    await sender.flushed();
    expect(sender.onSuperseded).toHaveBeenCalledExactlyOnceWith("s");
    expect(outbox.unsaved()).toEqual([]);
  });
});

describe("a tab that takes a session over", () => {
  it("isn't told by a late answer that another tab has it", async () => {
    const outbox = await memoryWith(0, 1);
    const server = new Server(async (nth, keep) => {
      await new Promise((resolve) => setTimeout(resolve, 1000));
      return { ...(await fine(nth, keep)), superseded: nth === 0 };
    });
    const sender = senderOf(outbox, server);
    const flushed = sender.flushed(); // Posted while the session was the other tab's ...
    await vi.advanceTimersByTimeAsync(500);
    sender.onSuperseded = vi.fn<(session: string) => void>(); // ... and answered when it isn't.
    await vi.runAllTimersAsync();
    await flushed;
    expect(sender.onSuperseded).not.toHaveBeenCalled();
    expect(outbox.unsaved()).toEqual([]);
  });
});

describe("a server that is down", () => {
  const down = async () => {
    throw new Error("status 503");
  };

  it("is asked again for ever, ever more seldom, at least every 15 seconds", async () => {
    vi.spyOn(Math, "random").mockReturnValue(1);
    const outbox = await memoryWith(0);
    const server = new Server(down);
    senderOf(outbox, server).start();
    await vi.advanceTimersByTimeAsync(3600_000);
    const waits = server.posted.map(({ at }, k) => at - (server.posted[k - 1]?.at ?? 0)).slice(1);
    expect(waits.slice(0, 7)).toEqual([500, 1000, 2000, 4000, 8000, 15_000, 15_000]);
    expect(waits.length).toBeGreaterThan(230);
    expect(new Set(server.numbers)).toEqual(new Set([0]));
    expect(outbox.unsaved()).toHaveLength(1);
  });

  it("has its trouble told, and no more when it is over", async () => {
    const trouble = new Error("status 503");
    const server = new Server(async (nth, keep) => {
      if (nth === 0) throw trouble;
      return fine(nth, keep);
    });
    const sender = senderOf(await memoryWith(0), server);
    const flushed = sender.flushed();
    await vi.advanceTimersByTimeAsync(0);
    expect(sender.trouble).toBe(trouble);
    await vi.runAllTimersAsync();
    await flushed;
    expect(sender.trouble).toBeUndefined();
  });

  it("isn't asked by all participants at the same moments", async () => {
    const draw = vi.spyOn(Math, "random");
    for (const [drawn, wait] of [[0, 250], [0.5, 375], [1, 500]] as const) {
      draw.mockReturnValue(drawn);
      const server = new Server(down);
      const began = Date.now();
      senderOf(await memoryWith(0), server).start();
      await vi.advanceTimersByTimeAsync(wait - 1);
      expect(server.posted).toHaveLength(1);
      await vi.advanceTimersByTimeAsync(1);
      expect(server.posted).toHaveLength(2);
      expect((server.posted[1]?.at ?? 0) - began).toBe(wait);
    }
  });

  it("is asked quickly again once it has answered", async () => {
    vi.spyOn(Math, "random").mockReturnValue(1);
    const server = new Server(async (nth, keep) => (nth === 5 ? fine(nth, keep) : down()));
    senderOf(await memoryWith(0, 1), server).start();
    await vi.advanceTimersByTimeAsync(15_500 + 600);
    expect(server.numbers).toEqual([0, 0, 0, 0, 0, 0, 1, 1]);
  });

  it("is asked at once when the browser is online again, or the page is looked at", async () => {
    const server = new Server(down);
    senderOf(await memoryWith(0), server).start();
    await vi.advanceTimersByTimeAsync(60_000);
    const before = server.posted.length;
    window.dispatchEvent(new Event("online"));
    await vi.advanceTimersByTimeAsync(0);
    expect(server.posted).toHaveLength(before + 1);
    document.dispatchEvent(new Event("visibilitychange"));
    await vi.advanceTimersByTimeAsync(0);
    expect(server.posted).toHaveLength(before + 2);
  });

  it("gets all in order when it is up again", async () => {
    const outbox = await memoryWith(0, 1, 2);
    const server = new Server(async (nth, keep) => (nth < 4 ? down() : fine(nth, keep)));
    const flushed = senderOf(outbox, server).flushed();
    await vi.runAllTimersAsync();
    await flushed;
    expect(server.numbers).toEqual([0, 0, 0, 0, 0, 1, 2]);
  });
});

describe("a refusal", () => {
  it.each([400, 401, 403, 404, 409, 410, 413, 422])("%i isn't tried again", async (status) => {
    const outbox = await memoryWith(0, 1);
    const server = new Server(async (nth, keep) => {
      if (nth === 0) throw new Refused("broken", status);
      return fine(nth, keep);
    });
    const sender = senderOf(outbox, server);
    await sender.flushed(); // Without a timer: it does not wait before it goes on.
    await sender.flushed();
    expect(server.numbers).toEqual([0, 1]);
    // It stays in the browser, for the file.
    expect(outbox.unsaved().map((entry) => entry.seq)).toEqual([0]);
  });

  it("is told of, with its session and its cause, until the record is taken", async () => {
    const outbox = await memoryWith(0, 1);
    const server = new Server(async (nth, keep) => {
      if (nth === 0) throw new Refused("broken", 413);
      return fine(nth, keep);
    });
    const sender = senderOf(outbox, server);
    await sender.flushed();
    expect(sender.refusal("s")).toMatchObject({ status: 413 });
    expect(sender.refusal("another")).toBeUndefined();
    sender.resend("s", [0]);
    await sender.flushed();
    expect(sender.refusal("s")).toBeUndefined();
  });

  it("429 means later", async () => {
    const outbox = await memoryWith(0, 1);
    const server = new Server(async (nth, keep) => {
      if (nth < 2) throw new Refused("busy", 429);
      return fine(nth, keep);
    });
    const flushed = senderOf(outbox, server).flushed();
    await vi.advanceTimersByTimeAsync(200);
    expect(server.numbers).toEqual([0]);
    await vi.runAllTimersAsync();
    await flushed;
    expect(server.numbers).toEqual([0, 0, 0, 1]);
  });

  it("is tried once more after a reload", async () => {
    const outbox = await Outbox.open();
    await outbox.put("s", 0, { x: 0 });
    const server = new Server(async (nth, keep) => {
      if (nth === 0) throw new Refused("broken", 403);
      return fine(nth, keep);
    });
    await senderOf(outbox, server).flushed();
    await senderOf(await Outbox.open(), server).flushed();
    expect(server.numbers).toEqual([0, 0]);
  });

  it("is tried again when the server says that it lacks the record", async () => {
    const outbox = await memoryWith(0, 1, 2);
    const server = new Server(async (nth, keep) => {
      if (nth === 0 || nth === 1) throw new Refused("broken", 404); // A proxy, in its stead.
      return fine(nth, keep);
    });
    const sender = senderOf(outbox, server);
    await sender.flushed();
    expect(outbox.unsaved().map((entry) => entry.seq)).toEqual([0, 1]);
    sender.resend("s", [1]);
    await sender.flushed();
    expect(server.numbers).toEqual([0, 1, 2, 1]);
    expect(outbox.unsaved().map((entry) => entry.seq)).toEqual([0]);
  });

  it("can't come from records that the server has lost", async () => {
    const outbox = await memoryWith(0, 1);
    const server = new Server(fine);
    const sender = senderOf(outbox, server);
    await sender.flushed();
    sender.resend("s", [1]);
    await sender.flushed();
    expect(server.numbers).toEqual([0, 1, 1]);
  });
});

describe("a reply that is lost", () => {
  it("has the same record posted again, and the server keeps it once", async () => {
    const outbox = await memoryWith(0, 1);
    const server = new Server(async (nth, keep) => {
      keep();
      if (nth === 0) throw new TypeError("Failed to fetch");
      return { superseded: false };
    });
    const flushed = senderOf(outbox, server).flushed();
    await vi.runAllTimersAsync();
    await flushed;
    expect(server.numbers).toEqual([0, 0, 1]);
    expect(server.posted[1]?.body).toEqual(server.posted[0]?.body);
    expect(server.kept).toHaveLength(2);
  });

  it("loses nothing, doubles nothing and changes no order, whatever else fails", async () => {
    const fates = fc.array(fc.constantFrom("fine", "request lost", "reply lost", "busy"), { maxLength: 30 });
    await fc.assert(
      fc.asyncProperty(fates, fc.integer({ min: 1, max: 8 }), async (fate, count) => {
        const numbers = Array.from({ length: count }, (_, k) => k);
        const outbox = await memoryWith(...numbers);
        const server = new Server(async (nth, keep) => {
          if (fate[nth] === "busy") throw new Refused("busy", 429);
          if (fate[nth] === "request lost") throw new TypeError("Failed to fetch");
          keep();
          if (fate[nth] === "reply lost") throw new TypeError("Failed to fetch");
          return { superseded: false };
        });
        const flushed = senderOf(outbox, server).flushed();
        await vi.runAllTimersAsync();
        await flushed;
        expect(server.kept).toEqual(numbers.map((seq) => `s ${seq} {"x":${seq}}`));
        expect(server.numbers).toEqual(server.numbers.toSorted((a, b) => a - b));
        expect(server.most).toBe(1);
        expect(outbox.unsaved()).toEqual([]);
      }),
    );
  });
});

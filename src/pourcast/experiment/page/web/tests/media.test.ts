/** Pictures and films come in the order in which they are needed, and in the end they come. */
import { beforeEach, describe, expect, it, vi } from "vitest";

import { waits } from "../src/backoff";
import { Media } from "../src/media";

/** A network that answers when a test says so. */
class Network {
  asked: string[] = [];
  private answers = new Map<string, (answer: Response | Error) => void>();

  constructor() {
    vi.stubGlobal("fetch", (url: string) => {
      this.asked.push(url);
      return new Promise<Response>((resolve, reject) => {
        this.answers.set(url, (answer) => (answer instanceof Error ? reject(answer) : resolve(answer)));
      });
    });
  }

  async answer(url: string, answer: Response | Error = new Response(url)): Promise<void> {
    this.answers.get(url)?.(answer);
    await vi.advanceTimersByTimeAsync(0);
  }
}

beforeEach(() => {
  vi.useFakeTimers({ toFake: ["setTimeout", "clearTimeout"] });
  let count = 0;
  vi.spyOn(URL, "createObjectURL").mockImplementation(() => `blob:${count++}`);
});

describe("files", () => {
  it("are fetched three at a time, each once, in their order", async () => {
    const network = new Network();
    const media = new Media((name) => `media/${name}`);
    media.preload(["a", "b", "c", "d", "", "a"]);
    media.preload(["d", "e"]);
    expect(network.asked).toEqual(["media/a", "media/b", "media/c"]);
    await network.answer("media/b");
    await network.answer("media/a");
    await network.answer("media/c");
    expect(network.asked).toEqual(["media/a", "media/b", "media/c", "media/d", "media/e"]);
    await network.answer("media/d");
    await network.answer("media/e");
    media.preload(["a", "e"]);
    expect(network.asked).toHaveLength(5);
  });

  it("that are waited for come before the others, to all that wait", async () => {
    const network = new Network();
    const media = new Media((name) => name);
    media.preload(["a", "b", "c", "d", "e", "f"]);
    const both = Promise.all([media.get("f"), media.get("f"), media.get("a")]);
    await network.answer("b");
    expect(network.asked).toEqual(["a", "b", "c", "f"]);
    await network.answer("f");
    await network.answer("a");
    const [one, other] = await both;
    expect(one).toBe(other);
    expect(await media.get("f")).toBe(one);
    expect(network.asked.filter((name) => name === "f")).toHaveLength(1);
  });

  it.each([new Response("", { status: 503 }), new Response("", { status: 404 }), new TypeError("Failed to fetch")])(
    "are fetched again after a fault (%s), until they are there",
    async (fault) => {
      const network = new Network();
      const media = new Media((name) => name);
      const got = media.get("a");
      await network.answer("a", fault);
      expect(network.asked).toEqual(["a"]);
      await vi.advanceTimersByTimeAsync(500);
      await network.answer("a", new TypeError("Failed to fetch"));
      await vi.advanceTimersByTimeAsync(1000);
      await network.answer("a");
      expect(await got).toBe("blob:0");
      expect(network.asked).toEqual(["a", "a", "a"]);
    },
  );
});

describe("a file", () => {
  it("that the server has not is told from one that is on its way, until it is there", async () => {
    const network = new Network();
    const media = new Media((name) => name);
    const got = media.get("a");
    await network.answer("a", new TypeError("Failed to fetch"));
    expect(media.lacks("a")).toBe(false);
    await vi.advanceTimersByTimeAsync(500);
    await network.answer("a", new Response("", { status: 503 }));
    expect(media.lacks("a")).toBe(false);
    await vi.advanceTimersByTimeAsync(1000);
    await network.answer("a", new Response("", { status: 404 }));
    expect(media.lacks("a")).toBe(true);
    await vi.advanceTimersByTimeAsync(2000);
    await network.answer("a");
    await got;
    expect(media.lacks("a")).toBe(false);
  });

  it("that never comes is asked for anew", async () => {
    const network = new Network();
    void new Media((name) => name).get("a");
    await vi.advanceTimersByTimeAsync(31_000);
    expect(network.asked).toEqual(["a", "a"]);
  });
});

describe("a slow connection", () => {
  it.each([40, 100, 400])("gets a file that takes %i seconds", async (seconds) => {
    vi.stubGlobal("fetch", async (_: string, { signal }: RequestInit) => {
      await new Promise((resolve, reject) => {
        setTimeout(resolve, 1000 * seconds);
        signal?.addEventListener("abort", () => reject(new DOMException("aborted", "AbortError")));
      });
      return new Response("film");
    });
    const got = new Media((name) => name).get("a");
    await vi.advanceTimersByTimeAsync(4_000_000);
    expect(await got).toBe("blob:0");
  });
});

describe("waits", () => {
  it("double up to the longest, and never end", () => {
    const wait = waits(3000);
    expect(Array.from({ length: 6 }, () => wait.next().value)).toEqual([500, 1000, 2000, 3000, 3000, 3000]);
  });
});

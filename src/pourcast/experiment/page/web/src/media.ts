/** Pictures and films, fetched ahead, a few at a time, and again if they stall. */

import { pause, waits } from "./backoff";
import { askForFile, isPassing, Unreachable } from "./network";

const PARALLEL = 3;
const TIMEOUT = 30_000;
const LONGEST = 600_000;

export class Media {
  private queue: string[] = [];
  private fetching = new Set<string>();
  private urls = new Map<string, string>();
  private waiting = new Map<string, ((url: string) => void)[]>();
  /** Files that the server said it has not, when it was asked last. */
  private missing = new Set<string>();

  constructor(private source: (name: string) => string) {}

  /** Fetches these next to whatever is being fetched; returns at once. */
  preload(names: string[]): void {
    for (const name of names) {
      if (name && !this.urls.has(name) && !this.queue.includes(name)) this.queue.push(name);
    }
    this.pump();
  }

  /** Local address of a file, when it is here. It is fetched before all that wait. */
  get(name: string): Promise<string> {
    const there = this.urls.get(name);
    if (there) return Promise.resolve(there);
    return new Promise((resolve) => {
      this.waiting.set(name, [...(this.waiting.get(name) ?? []), resolve]);
      if (this.queue.includes(name)) this.queue.splice(this.queue.indexOf(name), 1);
      if (!this.fetching.has(name)) this.queue.unshift(name);
      this.pump();
    });
  }

  /** Whether a file is not on its way, as the server has none of that name. */
  lacks(name: string): boolean {
    return this.missing.has(name);
  }

  private pump(): void {
    while (this.fetching.size < PARALLEL && this.queue.length) {
      const name = this.queue.shift() as string;
      if (this.urls.has(name) || this.fetching.has(name)) continue;
      this.fetching.add(name);
      void this.fetch(name).then((url) => {
        this.fetching.delete(name);
        this.urls.set(name, url);
        for (const resolve of this.waiting.get(name) ?? []) resolve(url);
        this.waiting.delete(name);
        this.pump();
      });
    }
  }

  private async fetch(name: string): Promise<string> {
    const wait = waits();
    // A film may take longer than any limit that finds out a connection that stalls.
    let limit = TIMEOUT;
    for (;;) {
      try {
        const { status, ok, content } = await askForFile(this.source(name), limit);
        if (ok) {
          this.missing.delete(name);
          return URL.createObjectURL(content);
        }
        if (!isPassing(status)) this.missing.add(name);
      } catch (error) {
        // Stalled or offline: again.
        if (error instanceof Unreachable && error.why === "silent") limit = Math.min(2 * limit, LONGEST);
      }
      await pause(wait.next().value);
    }
  }
}

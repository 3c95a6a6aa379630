/**
 * Records on their way to the server. A record is in IndexedDB before anything else happens, and
 * stays there until the whole session is known to be saved.
 */
import { openDB, type IDBPDatabase, type IDBPObjectStore } from "idb";

import { TooLate, within } from "./backoff";
import type { Body } from "./types";

export interface Entry {
  session: string;
  seq: number;
  body: Body;
  saved: boolean;
}

const STORE = "records";

/** How long the browser's database may take to answer [ms]; some never do (Safari 14, private windows). */
const PATIENCE = 3000;

type Store = IDBPObjectStore<unknown, [typeof STORE], typeof STORE, "readwrite">;

export class Outbox {
  private memory = new Map<string, Entry>();
  private patience = PATIENCE;

  private constructor(private database: IDBPDatabase | null) {
    this.survives = database !== null;
  }

  /** Whether the browser has kept all so far, so that a reload loses nothing. */
  survives: boolean;

  /** Opens the browser's database; where it has none (private windows), the page's memory. */
  static async open(): Promise<Outbox> {
    try {
      const opening = openDB("pourcast", 1, {
        upgrade: (fresh) => {
          fresh.createObjectStore(STORE, { keyPath: ["session", "seq"] });
        },
      });
      const outbox = new Outbox(await within(opening, PATIENCE));
      await outbox.read();
      return outbox;
    } catch {
      return new Outbox(null);
    }
  }

  /** Takes in what other tabs have kept since; nothing, where the browser's database fails. */
  async refresh(): Promise<void> {
    try {
      await this.read();
    } catch (error) {
      this.fail(error);
    }
  }

  private async read(): Promise<void> {
    const reading = this.database?.getAll(STORE) ?? Promise.resolve([]);
    const all = (await within(reading, this.patience)) as Entry[];
    for (const entry of all) {
      const key = keyOf(entry.session, entry.seq);
      if (!this.memory.has(key)) this.memory.set(key, entry);
    }
  }

  /**
   * Keeps a record. Resolves when it is on the disk. The first one of a step stays, be it of this
   * tab or of another.
   */
  async put(session: string, seq: number, body: Body): Promise<void> {
    const key = keyOf(session, seq);
    if (this.memory.has(key)) return;
    const entry = { session, seq, body, saved: false };
    const there = await this.change(async (store) => {
      const found = (await store.get([session, seq])) as Entry | undefined;
      if (!found) await store.add(entry);
      return found;
    });
    // Only now may it be posted, or the other tab's record would be marked as saved.
    if (!this.memory.has(key)) this.memory.set(key, there ?? entry);
  }

  async markSaved(entry: Entry): Promise<void> {
    entry.saved = true;
    await this.change((store) => store.put(entry));
  }

  /** Sends records again that the server says it has not. */
  markUnsaved(session: string, numbers: number[]): void {
    for (const seq of numbers) {
      const entry = this.memory.get(keyOf(session, seq));
      if (entry) entry.saved = false;
    }
  }

  unsaved(): Entry[] {
    return [...this.memory.values()]
      .filter((entry) => !entry.saved)
      .sort((a, b) => a.session.localeCompare(b.session) || a.seq - b.seq);
  }

  of(session: string): Entry[] {
    return [...this.memory.values()]
      .filter((entry) => entry.session === session)
      .sort((a, b) => a.seq - b.seq);
  }

  /** Forgets a session that is saved to its end. */
  async forget(session: string): Promise<void> {
    const entries = this.of(session);
    for (const entry of entries) this.memory.delete(keyOf(session, entry.seq));
    await this.change(async (store) => {
      for (const entry of entries) await store.delete([session, entry.seq]);
    });
  }

  /**
   * Changes the disk in one transaction. Without a disk, or with a full one, nothing is done: the
   * record is in memory, and on its way to the server. One that does not answer is waited for once.
   */
  private async change<T>(work: (store: Store) => Promise<T>): Promise<T | undefined> {
    try {
      const change = this.database?.transaction(STORE, "readwrite", { durability: "strict" });
      if (!change) return undefined;
      const [result] = await within(Promise.all([work(change.store), change.done]), this.patience);
      return result;
    } catch (error) {
      this.fail(error);
      return undefined;
    }
  }

  private fail(error: unknown): void {
    this.survives = false;
    if (error instanceof TooLate) this.patience = 0;
  }
}

function keyOf(session: string, seq: number): string {
  return `${session} ${seq}`;
}

/**
 * Records on their way to the server. A record is in IndexedDB before anything else happens, and
 * stays there until the whole session is known to be saved.
 */
import { openDB, type IDBPDatabase, type IDBPObjectStore } from "idb";

import type { Body } from "./types";

export interface Entry {
  session: string;
  seq: number;
  body: Body;
  saved: boolean;
}

const STORE = "records";

type Store = IDBPObjectStore<unknown, [typeof STORE], typeof STORE, "readwrite">;

export class Outbox {
  private memory = new Map<string, Entry>();

  private constructor(private database: IDBPDatabase | null) {}

  /** Opens the browser's database; where it has none (private windows), the page's memory. */
  static async open(): Promise<Outbox> {
    try {
      const database = await openDB("pourcast", 1, {
        upgrade: (fresh) => {
          fresh.createObjectStore(STORE, { keyPath: ["session", "seq"] });
        },
      });
      const outbox = new Outbox(database);
      await outbox.refresh();
      return outbox;
    } catch {
      return new Outbox(null);
    }
  }

  /** Takes in what other tabs have kept since. */
  async refresh(): Promise<void> {
    const all = ((await this.database?.getAll(STORE)) ?? []) as Entry[];
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
    for (const entry of this.of(session)) {
      this.memory.delete(keyOf(session, entry.seq));
      await this.database?.delete(STORE, [session, entry.seq]).catch(() => undefined);
    }
  }

  /** Changes the disk in one transaction; without a disk, or with a full one, nothing is done. */
  private async change<T>(work: (store: Store) => Promise<T>): Promise<T | undefined> {
    try {
      const change = this.database?.transaction(STORE, "readwrite", { durability: "strict" });
      if (!change) return undefined;
      const [result] = await Promise.all([work(change.store), change.done]);
      return result;
    } catch {
      // The browser's disk is full: the record is in memory, and on its way to the server.
      return undefined;
    }
  }
}

function keyOf(session: string, seq: number): string {
  return `${session} ${seq}`;
}

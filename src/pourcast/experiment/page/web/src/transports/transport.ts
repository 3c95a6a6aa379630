/** Who keeps the records: our server, or (in the folders that are exported) somebody else. */
import type { Entry } from "../outbox";
import type { Body, End, Farewell, Session } from "../types";
import type { Opening } from "./records";

/** The answer was no; asking again is no use. */
export class Refused extends Error {
  constructor(
    readonly reason: string,
    readonly status: number,
    /** What the participant should read. */
    readonly text = "",
  ) {
    super(reason);
  }
}

/** `state` is that of the session where it is another than was asked for. */
export type Ended = { missing: number[]; state?: string } & Partial<Farewell>;

export interface Transport {
  begin(request: string, tab: string): Promise<Session>;
  /** With a tab, the session is that tab's from now on. */
  resume(token: string, tab?: string): Promise<Session>;
  /** Resolves when the record is on the server's disk. */
  save(token: string, seq: number, body: Body, tab: string): Promise<{ superseded: boolean }>;
  /**
   * Ends the session, or names the steps that are missing; `entries` are all its records. Only the
   * tab that has the session can end it before it is complete.
   */
  finish(token: string, state: End, entries: Entry[], tab: string): Promise<Ended>;
  /** What says whose records follow, in the file that a participant downloads. */
  opening(session: Session): Opening;
  mediaUrl(name: string): string;
}

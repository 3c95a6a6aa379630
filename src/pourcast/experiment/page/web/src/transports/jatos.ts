/** JATOS: each record is appended to the run's result data as it comes, a line each. */
import { TooLate, within } from "../backoff";
import { isPassing, Unreachable } from "../network";
import type { Entry } from "../outbox";
import type { Body, End, Session } from "../types";
import {
  farewellOf,
  fetchPlan,
  missingOf,
  openingOf,
  Openings,
  sessionOf,
  type Plan,
  type PlannedOpening,
} from "./planned";
import { lineOf, recordOf } from "./records";
import { Refused, type Ended, type Transport } from "./transport";

/** What JATOS keeps for a run, and tells after a reload. */
interface Remembered {
  pourcast?: PlannedOpening;
}

/**
 * The part of jatos.js that is used (3.7 to 3.10). Its promises are rejected with a text, after it
 * tried six times itself: five seconds where nobody is reached, three minutes where nobody answers.
 */
interface Jatos {
  onLoad(callback: () => void): void;
  studySessionData: Remembered | null;
  setStudySessionData(data: object): PromiseLike<unknown>;
  appendResultData(data: string): PromiseLike<unknown>;
  urlQueryParameters?: { [name: string]: string };
  endStudyWithoutRedirect?(successful?: boolean): PromiseLike<unknown>;
}

declare const jatos: Jatos;

/** How long JATOS may take for anything [ms]; whatever it does later, a line that comes twice is no harm. */
const TIMEOUT = 60_000;

export class JatosTransport implements Transport {
  private loaded = new Promise<void>((resolve) => jatos.onLoad(() => resolve()));
  private plan: Plan | null = null;
  private openings = new Openings();
  /** Whether JATOS has the opening, so that it tells it after a reload. */
  private isKept: boolean | null = null;
  /** Sessions whose opening is among the results: told by this page, and no failure since. */
  private opened = new Set<string>();

  constructor(private link: { [name: string]: string }) {}

  async begin(request: string): Promise<Session> {
    const plan = await this.fetched();
    const identifiers = { ...this.link, ...jatos.urlQueryParameters };
    // A run that is reloaded goes on, even where the browser remembers nothing.
    const known = jatos.studySessionData?.pourcast;
    const opening = known ?? openingOf(plan, "jatos", identifiers, request);
    const session = sessionOf(plan, opening);
    this.openings.keep(opening);
    if (!this.isKept) {
      // jatos.js takes it for set even if it was lost on the way.
      await told(jatos.setStudySessionData({ ...jatos.studySessionData, pourcast: opening }));
      this.isKept = true;
    }
    return session;
  }

  async resume(token: string): Promise<Session> {
    const plan = await this.fetched();
    const known = jatos.studySessionData?.pourcast;
    if (known?.session !== token) throw new Refused("gone", 410);
    return sessionOf(plan, known);
  }

  async save(token: string, seq: number, body: Body): Promise<{ superseded: boolean }> {
    const plan = await this.fetched();
    const opening = this.openingOf(token);
    const { steps } = sessionOf(plan, opening);
    await this.append(opening, recordOf(opening, steps, { session: token, seq, body, saved: false }));
    return { superseded: false };
  }

  async finish(token: string, end: End, entries: Entry[]): Promise<Ended> {
    const plan = await this.fetched();
    const session = sessionOf(plan, this.openingOf(token));
    const saved = entries.filter((entry) => entry.saved);
    const missing = end === "complete" ? missingOf(session, saved) : [];
    if (missing.length) return { missing };
    await this.end(end === "complete");
    this.openings.forget(token);
    return { missing: [], ...farewellOf(plan, end, session.code) };
  }

  opening(session: Session): PlannedOpening {
    return this.openingOf(session.token);
  }

  mediaUrl(name: string): string {
    return `media/${name}`;
  }

  /** Of this run; or of an earlier one in this browser, of which something was left to be sent. */
  private openingOf(token: string): PlannedOpening {
    const own = jatos.studySessionData?.pourcast;
    const opening = own?.session === token ? own : this.openings.of(token);
    if (!opening) throw new Refused("gone", 410);
    return opening;
  }

  /** Appends a line; before the first one, and after any failure, the one that opens the session. */
  private async append(opening: PlannedOpening, record: object): Promise<void> {
    const { session } = opening;
    const contents = this.opened.has(session) ? [record] : [opening, record];
    this.opened.delete(session);
    await told(jatos.appendResultData(contents.map((content) => `${lineOf(content)}\n`).join("")));
    this.opened.add(session);
  }

  /** Says that the run is over; all its answers are there. */
  private async end(successful: boolean): Promise<void> {
    try {
      await told(jatos.endStudyWithoutRedirect?.(successful) ?? Promise.resolve());
    } catch (error) {
      // jatos.js asks but once: the run may then stand in its list as one that was not finished.
      if (!(error instanceof Refused)) throw error;
    }
  }

  private async fetched(): Promise<Plan> {
    await told(this.loaded);
    this.isKept ??= jatos.studySessionData?.pourcast !== undefined;
    this.plan ??= await fetchPlan();
    return this.plan;
  }
}

/** What JATOS did, or why it did not: in words of jatos.js, which names the server's status. */
async function told(done: PromiseLike<unknown>): Promise<void> {
  try {
    await within(done, TIMEOUT);
  } catch (error) {
    const said = (error as Error).message;
    if (error instanceof TooLate) throw new Unreachable("silent", said);
    const status = Number(/ failed: (\d{3})\b/.exec(said)?.[1] ?? 0);
    const isFinal = status ? !isPassing(status) : /invalid|only once/.test(said);
    if (isFinal) throw new Refused(said, status, said);
    if (status) throw new Unreachable("failing", said);
    throw new Unreachable(said.includes("timeout") ? "silent" : "offline", said);
  }
}

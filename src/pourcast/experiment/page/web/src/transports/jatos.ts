/** JATOS: each record is appended to the run's result data as it comes, a line each. */
import type { Entry } from "../outbox";
import type { Body, End, Session } from "../types";
import { farewellOf, fetchPlan, missingOf, openingOf, sessionOf, type Opening, type Plan } from "./planned";
import { Refused, type Ended, type Transport } from "./transport";

/** What JATOS keeps for a run, and tells after a reload. */
interface Remembered {
  pourcast?: Opening;
  /** Whether the line that opens the session is among the results. */
  pourcastOpened?: boolean;
}

/** The part of jatos.js that is used. */
interface Jatos {
  onLoad(callback: () => void): void;
  studySessionData: Remembered;
  setStudySessionData(data: object): Promise<unknown>;
  appendResultData(data: string): Promise<unknown>;
  urlQueryParameters?: { [name: string]: string };
  studyCode?: string;
  endStudyWithoutRedirect?(successful?: boolean): Promise<unknown>;
}

declare const jatos: Jatos;

export class JatosTransport implements Transport {
  private loaded = new Promise<void>((resolve) => jatos.onLoad(() => resolve()));
  private plan: Plan | null = null;

  constructor(private link: { [name: string]: string }) {}

  async begin(request: string): Promise<Session> {
    const plan = await this.fetched();
    const identifiers = { ...this.link, ...jatos.urlQueryParameters };
    // A run that is reloaded goes on, even where the browser remembers nothing.
    const opening =
      jatos.studySessionData.pourcast ?? openingOf(plan, "jatos", identifiers, request);
    const session = sessionOf(plan, opening);
    if (!jatos.studySessionData.pourcastOpened) {
      await this.remember({ pourcast: opening });
      // Records without this line belong to nobody: rather twice than never.
      await jatos.appendResultData(`${JSON.stringify(opening)}\n`);
      await this.remember({ pourcast: opening, pourcastOpened: true });
    }
    return session;
  }

  async resume(token: string): Promise<Session> {
    const plan = await this.fetched();
    const known = jatos.studySessionData.pourcast;
    if (known?.session !== token) throw new Refused("gone", 410);
    return sessionOf(plan, known);
  }

  async save(token: string, seq: number, body: Body): Promise<{ superseded: boolean }> {
    await this.loaded;
    await jatos.appendResultData(`${JSON.stringify({ session: token, seq, body })}\n`);
    return { superseded: false };
  }

  async finish(_token: string, end: End, entries: Entry[]): Promise<Ended> {
    const plan = await this.fetched();
    const session = sessionOf(plan, this.opening());
    const missing = end === "complete" ? missingOf(session, entries) : [];
    if (missing.length) return { missing };
    await jatos.endStudyWithoutRedirect?.(end === "complete");
    return { missing: [], ...farewellOf(plan, end, session.code) };
  }

  opening(): Opening {
    const known = jatos.studySessionData.pourcast;
    if (!known) throw new Refused("gone", 410);
    return known;
  }

  mediaUrl(name: string): string {
    return `media/${name}`;
  }

  private async remember(what: Remembered): Promise<void> {
    await jatos.setStudySessionData({ ...jatos.studySessionData, ...what });
  }

  private async fetched(): Promise<Plan> {
    await this.loaded;
    this.plan ??= await fetchPlan();
    return this.plan;
  }
}

/** A folder on any web host: records stay in the browser, and go to DataPipe at the end. */
import { recall, remember } from "../memory";
import type { Entry } from "../outbox";
import type { End, Session } from "../types";
import { sendToDataPipe } from "./datapipe";
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
import { fileOf } from "./records";
import { Refused, type Ended, type Transport } from "./transport";

export class StaticTransport implements Transport {
  private plan: Promise<Plan> | null = null;
  private openings = new Openings();

  constructor(private link: { [name: string]: string }) {}

  async begin(request: string): Promise<Session> {
    const plan = await this.fetched();
    const known = this.openings.of(request);
    const opening = known ?? openingOf(plan, "static", this.link, request);
    const session = sessionOf(plan, opening);
    this.openings.keep(opening);
    return session;
  }

  async resume(token: string): Promise<Session> {
    const plan = await this.fetched();
    const session = sessionOf(plan, this.openingOf(token));
    const ended = recall(endOf(token)) as { state: End } | undefined;
    if (!ended) return session;
    return { ...session, ...farewellOf(plan, ended.state, session.code), state: ended.state };
  }

  save(): Promise<{ superseded: boolean }> {
    return Promise.resolve({ superseded: false }); // It is in IndexedDB; nobody else is told yet.
  }

  async finish(token: string, end: End, entries: Entry[]): Promise<Ended> {
    const plan = await this.fetched();
    const opening = this.openingOf(token);
    const session = sessionOf(plan, opening);
    const missing = end === "complete" ? missingOf(session, entries) : [];
    if (missing.length) return { missing };
    if (end === "declined") this.openings.forget(token);
    else await this.send(plan, session, opening, end, entries);
    return { missing: [], ...farewellOf(plan, end, session.code) };
  }

  opening(session: Session): PlannedOpening {
    return this.openingOf(session.token);
  }

  private async send(
    plan: Plan,
    session: Session,
    opening: PlannedOpening,
    end: End,
    entries: Entry[],
  ): Promise<void> {
    if (!plan.datapipe) throw new Refused("file", 200);
    const file = fileOf(opening, session.steps, entries);
    await sendToDataPipe(plan.datapipe, `${opening.session}.json`, file, plan.texts.collecting);
    // Whoever loads the page again is told so, and does not begin anew unasked. Who it was, is forgotten.
    remember(endOf(opening.session), { state: end });
    this.openings.keep({ ...opening, identifiers: {} });
  }

  private openingOf(token: string): PlannedOpening {
    const opening = this.openings.of(token);
    if (!opening) throw new Refused("gone", 410);
    return opening;
  }

  mediaUrl(name: string): string {
    return `media/${name}`;
  }

  private fetched(): Promise<Plan> {
    this.plan ??= fetchPlan().catch((error: unknown) => {
      this.plan = null;
      throw error;
    });
    return this.plan;
  }
}

function endOf(token: string): string {
  return `pourcast end ${token}`;
}

/** A folder on any web host: records stay in the browser, and go to DataPipe at the end. */
import type { Entry } from "../outbox";
import type { End, Session } from "../types";
import {
  farewellOf,
  fetchPlan,
  lines,
  openingOf,
  sessionOf,
  type Opening,
  type Plan,
} from "./planned";
import { Refused, type Ended, type Transport } from "./transport";

const DATAPIPE = "https://pipe.jspsych.org/api/data/";
const TIMEOUT = 30_000;

export class StaticTransport implements Transport {
  private plan: Promise<Plan> | null = null;

  constructor(private link: { [name: string]: string }) {}

  async begin(request: string): Promise<Session> {
    const plan = await this.fetched();
    const opening = openingOf(plan, "static", this.link, request);
    localStorage.setItem(keyOf(request), JSON.stringify(opening));
    return sessionOf(plan, opening);
  }

  async resume(token: string): Promise<Session> {
    return sessionOf(await this.fetched(), this.opening(token));
  }

  async save(): Promise<{ superseded: boolean }> {
    return { superseded: false }; // It is in IndexedDB; there is nobody else to tell yet.
  }

  async finish(token: string, end: End, entries: Entry[]): Promise<Ended> {
    const plan = await this.fetched();
    const opening = this.opening(token);
    if (end !== "declined") {
      if (!plan.datapipe) throw new Refused("file", 200);
      await this.send(plan, token, lines(opening, token, entries));
    }
    localStorage.removeItem(keyOf(token));
    return { missing: [], ...farewellOf(plan, end, sessionOf(plan, opening).code) };
  }

  opening(token: string): Opening {
    const text = localStorage.getItem(keyOf(token));
    if (!text) throw new Refused("gone", 410);
    return JSON.parse(text) as Opening;
  }

  mediaUrl(name: string): string {
    return `media/${name}`;
  }

  private async send(plan: Plan, token: string, data: string): Promise<void> {
    const answer = await fetch(DATAPIPE, {
      method: "POST",
      headers: { "Content-Type": "application/json", Accept: "*/*" },
      body: JSON.stringify({ experimentID: plan.datapipe, filename: `${token}.jsonl`, data }),
      signal: AbortSignal.timeout(TIMEOUT),
    });
    if (answer.ok) return;
    const said = await answer.json().catch(() => ({}));
    // It has a file of this name: an earlier try came through, only its answer didn't.
    if (/FILE_EXISTS$/.test(said.error ?? "")) return;
    if (answer.status < 500) throw new Refused("offline", answer.status);
    throw new Error(`status ${answer.status}`);
  }

  private fetched(): Promise<Plan> {
    this.plan ??= fetchPlan().catch((error) => {
      this.plan = null;
      throw error;
    });
    return this.plan;
  }
}

function keyOf(token: string): string {
  return `pourcast session ${token}`;
}

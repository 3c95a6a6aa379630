/** A folder on any web host: records stay in the browser, and go to DataPipe at the end. */
import type { Entry } from "../outbox";
import type { End, Session } from "../types";
import {
  farewellOf,
  fetchPlan,
  lines,
  missingOf,
  openingOf,
  sessionOf,
  type Opening,
  type Plan,
} from "./planned";
import { isPassing, Refused, type Ended, type Transport } from "./transport";

const DATAPIPE = "https://pipe.jspsych.org/api/data/";
const TIMEOUT = 30_000;

export class StaticTransport implements Transport {
  private plan: Promise<Plan> | null = null;
  private openings = new Map<string, Opening>();

  constructor(private link: { [name: string]: string }) {}

  async begin(request: string): Promise<Session> {
    const plan = await this.fetched();
    const opening = this.known(request) ?? openingOf(plan, "static", this.link, request);
    this.openings.set(request, opening);
    try {
      localStorage.setItem(keyOf(request), JSON.stringify(opening));
    } catch {
      // Without it a reload begins anew.
    }
    return sessionOf(plan, opening);
  }

  async resume(token: string): Promise<Session> {
    return sessionOf(await this.fetched(), this.openingOf(token));
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
    if (end !== "declined") {
      if (!plan.datapipe) throw new Refused("file", 200);
      await this.send(plan, token, lines(opening, token, entries));
    }
    try {
      localStorage.removeItem(keyOf(token));
    } catch {
      // There is nothing to be removed.
    }
    return { missing: [], ...farewellOf(plan, end, session.code) };
  }

  opening(session: Session): Opening {
    return this.openingOf(session.token);
  }

  private openingOf(token: string): Opening {
    const opening = this.known(token);
    if (!opening) throw new Refused("gone", 410);
    return opening;
  }

  private known(token: string): Opening | undefined {
    const own = this.openings.get(token);
    if (own) return own;
    try {
      const text = localStorage.getItem(keyOf(token));
      return text ? (JSON.parse(text) as Opening) : undefined;
    } catch {
      return undefined;
    }
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
    const said = (await answer.json().catch(() => ({}))) as { error?: string };
    // It has a file of this name: an earlier try came through, only its answer didn't.
    if (said.error?.endsWith("FILE_EXISTS")) return;
    if (isPassing(answer.status)) throw new Error(`status ${answer.status}`);
    throw new Refused("offline", answer.status);
  }

  private fetched(): Promise<Plan> {
    this.plan ??= fetchPlan().catch((error: unknown) => {
      this.plan = null;
      throw error;
    });
    return this.plan;
  }
}

function keyOf(token: string): string {
  return `pourcast session ${token}`;
}

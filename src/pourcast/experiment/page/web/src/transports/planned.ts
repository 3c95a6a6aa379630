/** What the exported pages share: their plan is a file, and the browser chooses its place in it. */
import { drawn } from "../draws";
import { forget, recall, remember } from "../memory";
import { askForJson, isPassing, Unreachable } from "../network";
import type { Entry } from "../outbox";
import type { End, Experiment, Farewell, Session, Step } from "../types";
import { FORMAT, type Opening } from "./records";
import { Refused } from "./transport";

const TIMEOUT = 30_000;

interface Place {
  group: number;
  place: number;
  steps: Step[];
}

/** `plan.json`, written by `experiment/export.py`. */
export interface Plan extends Experiment {
  places: Place[];
  codes: { complete: string; screened_out: string; failed_check: string };
  redirect: string;
  datapipe: string;
}

/** A session that no server knows, whole. */
export type PlannedOpening = Required<Opening>;

export async function fetchPlan(): Promise<Plan> {
  const { status, ok, content } = await askForJson("plan.json", { cache: "no-cache" }, TIMEOUT);
  if (ok) return content as Plan;
  if (isPassing(status)) throw new Unreachable("failing", `status ${status}`);
  throw new Refused(`plan.json: status ${status}`, status);
}

/** Openings of the sessions that this browser has begun, by their names. */
export class Openings {
  private here = new Map<string, PlannedOpening>();

  keep(opening: PlannedOpening): void {
    this.here.set(opening.session, opening);
    remember(keyOf(opening.session), opening);
  }

  forget(session: string): void {
    this.here.delete(session);
    forget(keyOf(session));
  }

  of(session: string): PlannedOpening | undefined {
    return this.here.get(session) ?? (recall(keyOf(session)) as PlannedOpening | undefined);
  }
}

function keyOf(session: string): string {
  return `pourcast session ${session}`;
}

export function openingOf(
  plan: Plan,
  entry: string,
  identifiers: { [name: string]: string },
  session: string,
): PlannedOpening {
  const [at] = drawn(1) as [number];
  const chosen = plan.places[at % plan.places.length] as Place;
  return {
    ...FORMAT,
    session,
    entry,
    identifiers,
    group: chosen.group,
    place: chosen.place,
  };
}

export function sessionOf(plan: Plan, opening: PlannedOpening): Session {
  const chosen = plan.places.find(
    (one) => one.group === opening.group && one.place === opening.place,
  );
  if (!chosen) throw new Refused("gone", 410, plan.texts["stop"].gone);
  return {
    ...plan,
    token: opening.session,
    key: opening.session,
    participant: "",
    entry: opening.entry,
    state: "open",
    code: opening.session.slice(0, 8).toUpperCase(),
    redirect: "",
    steps: chosen.steps,
    done: [],
  };
}

export function farewellOf(plan: Plan, end: End, own: string): Farewell {
  const given = end === "declined" ? "" : plan.codes[end];
  const code = given || (end === "complete" ? own : "");
  return { code, redirect: code ? plan.redirect.split("{code}").join(code) : "" };
}

export function missingOf(session: Session, entries: Entry[]): number[] {
  const there = new Set(entries.map((entry) => entry.seq));
  return session.steps.map((step) => step.seq).filter((seq) => !there.has(seq));
}

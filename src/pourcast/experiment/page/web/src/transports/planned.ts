/** What the exported pages share: their plan is a file, and the browser chooses its place in it. */
import type { Entry } from "../outbox";
import type { End, Experiment, Farewell, Session, Step } from "../types";
import { Refused } from "./transport";

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

/** What identifies a session that no server knows. */
export interface Opening {
  format: "pourcast-records";
  schema_version: 1;
  session: string;
  entry: string;
  identifiers: { [name: string]: string };
  group: number;
  place: number;
}

export async function fetchPlan(): Promise<Plan> {
  const answer = await fetch("plan.json", { cache: "no-cache" });
  if (!answer.ok) throw new Error(`status ${answer.status}`);
  return (await answer.json()) as Plan;
}

export function openingOf(
  plan: Plan,
  entry: string,
  identifiers: { [name: string]: string },
  session: string,
): Opening {
  const at = crypto.getRandomValues(new Uint32Array(1))[0] as number;
  const chosen = plan.places[at % plan.places.length] as Place;
  return {
    format: "pourcast-records",
    schema_version: 1,
    session,
    entry,
    identifiers,
    group: chosen.group,
    place: chosen.place,
  };
}

export function sessionOf(plan: Plan, opening: Opening): Session {
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
  return { code, redirect: code ? plan.redirect.replaceAll("{code}", () => code) : "" };
}

/** A session as JSON Lines, which `pourcast experiment data --import` takes. */
export function lines(opening: object, session: string, entries: Entry[]): string {
  const records = entries.map(({ seq, body }) => ({ session, seq, body }));
  return [opening, ...records].map((line) => `${JSON.stringify(line)}\n`).join("");
}

export function missingOf(session: Session, entries: Entry[]): number[] {
  const there = new Set(entries.map((entry) => entry.seq));
  return session.steps.map((step) => step.seq).filter((seq) => !there.has(seq));
}

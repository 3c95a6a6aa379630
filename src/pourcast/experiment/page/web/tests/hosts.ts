/** Stand-ins for those who keep records: our server, JATOS, a folder on a web host with DataPipe. */
import { vi } from "vitest";

import type { Plan } from "../src/transports/planned";
import type { Body, Session, Step } from "../src/types";

export const STEPS: Step[] = [
  { seq: 0, kind: "consent" },
  { seq: 1, kind: "judgment", phase: "test", trial: 1, block: 1, still: "a.png" },
  { seq: 2, kind: "debrief" },
];

export function planOf(changed: Partial<Plan> = {}): Plan {
  return {
    texts: {
      stop: { gone: "It is gone." },
      collecting: {
        inactive: "not switched on",
        unknown: "study not known",
        limit: "no more people",
        invalid: "another form",
        storage: "no place",
        large: "too large",
        other: "answered {said}",
      },
    },
    places: [
      { group: 0, place: 0, steps: STEPS },
      { group: 1, place: 0, steps: STEPS.toReversed() },
      { group: 1, place: 1, steps: STEPS },
    ],
    codes: { complete: "DONE1", screened_out: "OUT1", failed_check: "" },
    redirect: "https://app.example.org/?cc={code}",
    datapipe: "ABC123",
    ...changed,
  } as Plan;
}

type Content = { [key: string]: unknown };

/** What jatos.js rejects its promises with. */
async function rejected(text: string): Promise<never> {
  // oxlint-disable-next-line typescript/only-throw-error
  throw text;
}

function answer(status: number, content: unknown): Response {
  return new Response(JSON.stringify(content), { status });
}

/** A network: what it carries to whom, and what it loses. */
export abstract class Network {
  /** How the next requests fail: `no answer` comes after the request has been done. */
  failures: ("unreachable" | "silent" | "no answer" | number | "nonsense")[] = [];
  requests: { method: string; url: string; headers: Headers; content: Content }[] = [];

  install(): this {
    vi.stubGlobal("fetch", async (url: string, init: RequestInit = {}) => {
      const fails = this.failures.shift();
      if (fails === "silent") return new Promise(() => undefined);
      if (fails === "unreachable") throw new TypeError("Failed to fetch");
      if (fails === "nonsense") return new Response("<h1>Please log in to this network</h1>");
      if (typeof fails === "number") return answer(fails, { error: "not now" });
      const headers = new Headers(init.headers);
      const content = JSON.parse(typeof init.body === "string" ? init.body : "{}") as Content;
      const method = init.method ?? "GET";
      this.requests.push({ method, url, headers, content });
      const said = this.handle(method, url, headers, content);
      if (fails === "no answer") throw new TypeError("Failed to fetch");
      return said;
    });
    return this;
  }

  protected abstract handle(method: string, url: string, headers: Headers, content: Content): Response;
}

/** `experiment/server/app.py`, as far as the page knows it. */
export class OurServer extends Network {
  sessions = new Map<string, { request: string; tab: string | undefined; kept: Map<number, Body>; state: string }>();

  protected handle(method: string, url: string, headers: Headers, content: Content): Response {
    const tab = content["tab"] as string | undefined;
    if (method === "POST" && url === "api/sessions") {
      const request = String(content["request"]);
      const known = [...this.sessions].find(([, one]) => one.request === request)?.[0];
      const token = known ?? `token-of-${request}`;
      if (!known) this.sessions.set(token, { request, tab, kept: new Map(), state: "open" });
      return answer(201, { ...this.told(token), token });
    }
    const token = headers.get("Authorization")?.replace("Bearer ", "") ?? "";
    const session = this.sessions.get(token);
    if (!session) return answer(401, { refused: "gone", text: "It is gone." });
    if (method === "POST" && url === "api/session/resume") {
      if (tab) session.tab = tab;
      return answer(200, this.told(token));
    }
    if (method === "POST" && url === "api/session/finish") {
      const missing = STEPS.map(({ seq }) => seq).filter((seq) => !session.kept.has(seq));
      const state = String(content["state"]);
      if (state === "complete" && missing.length) return answer(200, { missing });
      session.state = state;
      const code = state === "complete" ? "DONE1" : "";
      const redirect = code ? "https://app.example.org/?cc=DONE1" : "";
      return answer(200, { missing: [], code, redirect });
    }
    const seq = /^api\/session\/records\/(\d+)$/.exec(url)?.[1];
    if (method !== "PUT" || !seq) return answer(404, { error: "no such page" });
    if (!session.kept.has(Number(seq))) session.kept.set(Number(seq), content["body"] as Body);
    return answer(200, { saved: "new", superseded: session.tab !== tab });
  }

  private told(token: string): Partial<Session> {
    const session = this.sessions.get(token);
    const done = [...(session?.kept.keys() ?? [])];
    return { key: `key-of-${token}`, steps: STEPS, done, state: session?.state ?? "", code: "K7", entry: "link" };
  }
}

/** Whether a file passes the rules of DataPipe (functions/src/validate-json.ts and validate-csv.ts). */
function passes(data: string, required: string[], allowed: { json: boolean; csv: boolean }): boolean {
  const has = (fields: string[]) => required.every((field) => fields.includes(field));
  if (allowed.json) {
    try {
      const parsed = JSON.parse(data) as object | object[];
      const fields = Array.isArray(parsed) ? parsed.flatMap((one) => Object.keys(one as object)) : Object.keys(parsed);
      if (has(fields)) return true;
    } catch {
      // Not JSON.
    }
  }
  return allowed.csv && has((data.split("\n")[0] ?? "").split(",").map((cell) => cell.replaceAll('"', "")));
}

/** A web host that has the exported folder, and DataPipe as it is when an experiment is new and switched on. */
export class WebHost extends Network {
  files = new Map<string, string>();
  datapipe = {
    experiments: ["ABC123"],
    active: true,
    finalized: false,
    limit: Infinity,
    validation: true,
    required: ["trial_type"],
    json: true,
    csv: true,
    owner: true,
    /** The storage behind it: it takes files, it can't be reached, or it is no account's any more. */
    storage: "there" as "there" | "away" | "queued" | "not connected",
    largest: 32 * 2 ** 20,
  };

  constructor(public plan = planOf()) {
    super();
  }

  protected handle(method: string, url: string, _: Headers, content: Content): Response {
    if (method === "GET" && url === "plan.json") return answer(200, this.plan);
    if (method === "POST" && url === "https://pipe.jspsych.org/api/data/") return this.pipe(content);
    return answer(404, {});
  }

  /** In the order of functions/src/api-data.ts. */
  private pipe(content: Content): Response {
    const { experimentID, filename, data } = content as { experimentID?: string; filename?: string; data?: string };
    const set = this.datapipe;
    const no = (status: number, error: string) => answer(status, { error, message: "Words." });
    if ((data ?? "").length > set.largest) return new Response("Payload Too Large", { status: 413 });
    if (!experimentID || !data || !filename) return no(400, "MISSING_PARAMETER");
    if (!set.experiments.includes(experimentID)) return no(400, "EXPERIMENT_NOT_FOUND");
    if (set.finalized) return no(400, "EXPERIMENT_FINALIZED");
    if (!set.active) return no(400, "DATA_COLLECTION_NOT_ACTIVE");
    if (this.files.size >= set.limit) return no(400, "SESSION_LIMIT_REACHED");
    if (set.validation && !passes(data, set.required, set)) return no(400, "INVALID_DATA");
    if (!set.owner) return no(400, "INVALID_OWNER");
    if (set.storage === "not connected") return no(400, "PROVIDER_NOT_CONNECTED");
    if (this.files.has(filename)) return no(400, "FILE_EXISTS");
    if (set.storage === "away") return no(400, "UPLOAD_ERROR");
    this.files.set(filename, data);
    return set.storage === "queued" ? answer(202, { error: null }) : answer(201, { message: "Success" });
  }
}

/**
 * As much of jatos.js as the page uses, failing as it fails: with a text after it tried often, or
 * after a long silence. It takes what it could not send for set, and asks for the end but once.
 */
export class JatosHost extends WebHost {
  results = "";
  ended: boolean | null = null;
  /** What becomes of the next things that are sent to JATOS; `undefined` is fine. */
  fates: (undefined | "offline" | "silent" | "answer lost" | 400 | 403 | 413 | 500)[] = [];
  private kept = "{}";

  override install(): this {
    super.install();
    return this.load();
  }

  private async carry(method: string, work: () => void): Promise<void> {
    const fate = this.fates.shift();
    const failed = (why: string) => rejected(`${method} to ../resultData failed: ${why}`);
    if (fate === "silent") return new Promise(() => undefined);
    if (fate === "offline") return failed("");
    if (typeof fate === "number") return failed(`${fate}, Words, More words`);
    work();
    return fate ? failed("timeout") : undefined;
  }

  /** What a reload brings: the session's data, as JATOS has them. */
  load(): this {
    let endings = 0;
    const jatos = {
      studySessionData: JSON.parse(this.kept) as object,
      urlQueryParameters: { PROLIFIC_PID: "p7" },
      onLoad: (callback: () => void) => setTimeout(callback, 0),
      setStudySessionData: (data: object) => {
        jatos.studySessionData = data;
        return this.carry("POST", () => (this.kept = JSON.stringify(data)));
      },
      appendResultData: (data: string) => this.carry("POST", () => (this.results += data)),
      endStudyWithoutRedirect: (successful: boolean) => {
        if (endings++) return rejected("Can end/abort study only once.");
        return this.carry("GET", () => (this.ended = successful));
      },
    };
    vi.stubGlobal("jatos", jatos);
    return this;
  }
}

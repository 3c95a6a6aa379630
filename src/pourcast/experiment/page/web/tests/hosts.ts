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
    texts: { stop: { gone: "It is gone." } },
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

function answer(status: number, content: unknown): Response {
  return new Response(JSON.stringify(content), { status });
}

/** A network: what it carries to whom, and what it loses. */
export abstract class Network {
  /** How the next requests fail: `no answer` comes after the request has been done. */
  failures: ("unreachable" | "no answer" | number | "nonsense")[] = [];
  requests: { method: string; url: string; headers: Headers; content: Content }[] = [];

  install(): this {
    vi.stubGlobal("fetch", async (url: string, init: RequestInit = {}) => {
      const fails = this.failures.shift();
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

/** A web host that has the exported folder, and DataPipe. */
export class WebHost extends Network {
  files = new Map<string, string>();
  refuses: { status: number; error: string } | null = null;

  constructor(public plan = planOf()) {
    super();
  }

  protected handle(method: string, url: string, _: Headers, content: Content): Response {
    if (method === "GET" && url === "plan.json") return answer(200, this.plan);
    if (method === "POST" && url === "https://pipe.jspsych.org/api/data/") {
      if (this.refuses) return answer(this.refuses.status, { error: this.refuses.error });
      const name = String(content["filename"]);
      if (this.files.has(name)) return answer(400, { error: "OSF_FILE_EXISTS" });
      this.files.set(name, String(content["data"]));
      return answer(201, {});
    }
    return answer(404, {});
  }
}

/** As much of jatos.js as the page uses. */
export class JatosHost extends WebHost {
  results = "";
  ended: boolean | null = null;
  /** How often what is sent to JATOS fails, after so many times that it does not. */
  lost = { after: 0, count: 0 };
  private kept = "{}";

  override install(): this {
    super.install();
    return this.load();
  }

  /** What a reload brings: the session's data, as JATOS has them. */
  load(): this {
    const carry = async (work: () => void) => {
      if (this.lost.after > 0) this.lost.after -= 1;
      else if (this.lost.count > 0) {
        this.lost.count -= 1;
        throw new Error("JATOS can't be reached");
      }
      work();
    };
    const jatos = {
      studySessionData: JSON.parse(this.kept) as object,
      urlQueryParameters: { PROLIFIC_PID: "p7" },
      onLoad: (callback: () => void) => setTimeout(callback, 0),
      setStudySessionData: (data: object) => {
        jatos.studySessionData = data;
        return carry(() => (this.kept = JSON.stringify(data)));
      },
      appendResultData: (data: string) => carry(() => (this.results += data)),
      endStudyWithoutRedirect: (successful: boolean) => carry(() => (this.ended = successful)),
    };
    vi.stubGlobal("jatos", jatos);
    return this;
  }
}

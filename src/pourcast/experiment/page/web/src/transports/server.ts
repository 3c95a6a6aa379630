/** Our own server, `experiment/server/app.py`. */
import { askForJson, isPassing, Unreachable } from "../network";
import type { Entry } from "../outbox";
import type { Body, End, Session } from "../types";
import { FORMAT, type Opening } from "./records";
import { Refused, type Ended, type Transport } from "./transport";

const TIMEOUT = 20_000;

export class ServerTransport implements Transport {
  constructor(private link: { [name: string]: string }) {}

  begin(request: string, tab: string): Promise<Session> {
    return this.ask("POST", "api/sessions", { request, tab, link: this.link });
  }

  async resume(token: string, tab?: string): Promise<Session> {
    return { ...(await this.ask<Session>("POST", "api/session/resume", { tab }, token)), token };
  }

  save(token: string, seq: number, body: Body, tab: string): Promise<{ superseded: boolean }> {
    return this.ask("PUT", `api/session/records/${seq}`, { tab, body }, token);
  }

  finish(token: string, state: End, _: Entry[], tab: string): Promise<Ended> {
    return this.ask("POST", "api/session/finish", { state, tab }, token);
  }

  opening(session: Session): Opening {
    return { ...FORMAT, session: session.key };
  }

  mediaUrl(name: string): string {
    return `media/${name}`;
  }

  private async ask<T>(method: string, path: string, content: object, token = ""): Promise<T> {
    const headers = {
      "Content-Type": "application/json",
      ...(token ? { Authorization: `Bearer ${token}` } : {}),
    };
    const init: RequestInit = { method, headers, body: JSON.stringify(content), cache: "no-store" };
    const answer = await askForJson(path, init, TIMEOUT);
    if (answer.ok) return answer.content as T;
    const said = (answer.content ?? {}) as { refused?: string; text?: string };
    // A refusal of our server's is final, even where a proxy's answer of this status would pass.
    if (!said.refused && isPassing(answer.status))
      throw new Unreachable("failing", `status ${answer.status}`);
    throw new Refused(said.refused ?? "broken", answer.status, said.text);
  }
}

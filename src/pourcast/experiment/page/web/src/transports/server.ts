/** Our own server, `experiment/server/app.py`. */
import type { Entry } from "../outbox";
import type { Body, End, Session } from "../types";
import { isPassing, Refused, type Ended, type Transport } from "./transport";

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

  opening(session: Session): object {
    return { format: "pourcast-records", schema_version: 1, session: session.key };
  }

  mediaUrl(name: string): string {
    return `media/${name}`;
  }

  private async ask<T>(method: string, path: string, content: object, token = ""): Promise<T> {
    const answer = await fetch(path, {
      method,
      headers: {
        "Content-Type": "application/json",
        ...(token ? { Authorization: `Bearer ${token}` } : {}),
      },
      body: JSON.stringify(content),
      signal: AbortSignal.timeout(TIMEOUT),
      cache: "no-store",
    });
    if (answer.ok) return (await answer.json()) as T;
    const said = (await answer.json().catch(() => ({}))) as { refused?: string; text?: string };
    // A refusal of our server's is final, even where a proxy's answer of this status would pass.
    if (!said.refused && isPassing(answer.status)) throw new Error(`status ${answer.status}`);
    throw new Refused(said.refused ?? "broken", answer.status, said.text);
  }
}

/** Who keeps the records: our server, or (in the folders that are exported) somebody else. */
import type { Body, End, Farewell, Session } from "./types";

/** The answer was no; asking again is no use. */
export class Refused extends Error {
  constructor(
    readonly reason: string,
    readonly status: number,
    /** What the participant should read. */
    readonly text = "",
  ) {
    super(reason);
  }
}

export interface Transport {
  begin(request: string, tab: string): Promise<Session>;
  resume(token: string, tab: string): Promise<Session>;
  /** Resolves when the record is on the server's disk. */
  save(token: string, seq: number, body: Body, tab: string): Promise<{ superseded: boolean }>;
  finish(token: string, state: End): Promise<{ missing: number[] } & Partial<Farewell>>;
  mediaUrl(name: string): string;
}

const TIMEOUT = 20_000;

/** Our own server. */
export class ServerTransport implements Transport {
  constructor(private link: { [name: string]: string }) {}

  begin(request: string, tab: string): Promise<Session> {
    return this.ask("POST", "api/sessions", { request, tab, link: this.link });
  }

  async resume(token: string, tab: string): Promise<Session> {
    return { ...(await this.ask<Session>("POST", "api/session/resume", { tab }, token)), token };
  }

  save(token: string, seq: number, body: Body, tab: string): Promise<{ superseded: boolean }> {
    return this.ask("PUT", `api/session/records/${seq}`, { tab, body }, token);
  }

  finish(token: string, state: End): Promise<{ missing: number[] } & Partial<Farewell>> {
    return this.ask("POST", "api/session/finish", { state }, token);
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
    if (answer.status >= 500 || answer.status === 408)
      throw new Error(`status ${answer.status}`);
    const said = await answer.json().catch(() => ({}));
    throw new Refused(said.refused ?? "broken", answer.status, said.text);
  }
}

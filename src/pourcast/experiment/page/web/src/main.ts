/** The participant's page: begins or resumes a session, runs it, and ends when all is saved. */
import "./page.css";

import { initJsPsych, type JsPsych } from "jspsych";

import { pause, waits } from "./backoff";
import { Media } from "./media";
import { Outbox } from "./outbox";
import { Sender } from "./sender";
import { Tabs } from "./tabs";
import { Timeline } from "./timeline";
import { makeTransport } from "./transports";
import { lines } from "./transports/planned";
import { Refused, type Transport } from "./transports/transport";
import type { End, Farewell, Session } from "./types";
import { escaped, pageOf } from "./words";

/** How long the last page waits for the server before it offers the file [ms]. */
const PATIENCE = 20_000;

const page = document.getElementById("page") as HTMLElement;

/** Words that the page itself brings, for when the server can't be reached. */
const words = page.dataset as { reaching: string; unreachable: string; broken: string };

function show(html: string): void {
  page.innerHTML = `<div class="text" role="status">${html}</div>`;
}

function makeWord(): string {
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  return [...bytes].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

/** What this browser remembers of a link: which request it made, which token it got. */
class Memory {
  constructor(private key: string) {}

  read(): { request?: string; token?: string } {
    try {
      return JSON.parse(localStorage.getItem(this.key) ?? "{}") as { request?: string; token?: string };
    } catch {
      return {};
    }
  }

  write(content: { request?: string; token?: string }): void {
    try {
      localStorage.setItem(this.key, JSON.stringify(content));
    } catch {
      // Without it a reload begins anew; nothing that was answered is lost.
    }
  }
}

async function patiently<T>(ask: () => Promise<T>): Promise<T> {
  const wait = waits();
  for (;;) {
    try {
      return await ask();
    } catch (error) {
      if (error instanceof Refused) throw error;
      show(`<p>${escaped(words.unreachable)}</p>`);
      await pause(wait.next().value);
    }
  }
}

class Study {
  private tab = makeWord();
  private memory: Memory;
  private tabs: Tabs;
  private transport: Transport;
  private sender: Sender;
  private jsPsych: JsPsych | null = null;
  private ended: End | "moved" | null = null;

  constructor(
    private outbox: Outbox,
    private link: { [name: string]: string },
  ) {
    const key = `pourcast ${new URLSearchParams(link).toString()}`;
    this.memory = new Memory(key);
    this.tabs = new Tabs(this.tab, key);
    this.transport = makeTransport(link);
    this.sender = new Sender(outbox, this.transport, this.tab);
  }

  async run(): Promise<void> {
    show(`<p>${escaped(words.reaching)}</p>`);
    // What an earlier visit could not send, whosever it was.
    this.sender.start();
    const elsewhere = await this.tabs.elsewhere();
    let session: Session;
    let resumed: boolean; // whether there was a session before this page
    try {
      [session, resumed] = await this.session();
    } catch (error) {
      const said = error instanceof Refused ? error.text : "";
      show(`<p>${escaped(said || words.broken)}</p>`);
      return;
    }
    document.title = session.texts["page"].title;
    if (session.state !== "open") {
      this.farewell(session, session.state as End, session);
      return;
    }
    if (elsewhere) await this.askWhere(session);
    this.tabs.onTaken = () => this.moveAway(session);
    this.tabs.take();
    if (elsewhere || resumed) {
      // Only now, as the other tab may have answered until it was told.
      try {
        session = await this.known(session.token, this.tab);
      } catch (error) {
        const said = error instanceof Refused ? error.text : "";
        show(`<p>${escaped(said || words.broken)}</p>`);
        return;
      }
    }
    this.sender.onSuperseded = (token) => {
      if (token === session.token) this.moveAway(session);
    };
    await this.play(session, resumed);
  }

  /** The session, and whether it goes on; no other tab is told yet. */
  private async session(): Promise<[Session, boolean]> {
    const known = this.memory.read();
    if (known.token) {
      try {
        const session = await this.known(known.token);
        const over = session.state === "complete" && session.entry === "lab";
        if (!over) return [session, true];
      } catch (error) {
        if (!(error instanceof Refused) || error.reason !== "gone") throw error;
      }
    }
    // The same request, posted again, gets the same session.
    const request = (!known.token && known.request) || makeWord();
    this.memory.write({ request });
    const session = await patiently(() => this.transport.begin(request, this.tab));
    this.memory.write({ request, token: session.token });
    return [session, session.done.length > 0];
  }

  /** A session that is known; what waits to be sent counts as done. With a tab, it is that tab's. */
  private async known(token: string, tab?: string): Promise<Session> {
    const session = await patiently(() => this.transport.resume(token, tab));
    await this.outbox.refresh();
    const own = this.outbox.of(token).map((entry) => entry.seq);
    session.done = [...new Set([...session.done, ...own])];
    return session;
  }

  /** Asks whoever has the study open elsewhere to go on there, or here. */
  private askWhere(session: Session): Promise<void> {
    const texts = session.texts.tabs;
    show(`${pageOf(texts.title, texts.body)}<button class="jspsych-btn">${escaped(texts.button)}</button>`);
    const button = page.querySelector("button") as HTMLButtonElement;
    button.focus();
    return new Promise((resolve) => button.addEventListener("click", () => resolve()));
  }

  private moveAway(session: Session): void {
    if (this.ended) return;
    this.stop("moved");
    this.sayMoved(session);
  }

  private sayMoved(session: Session): void {
    show(`<p>${escaped(session.texts["tabs"].moved)}</p>`);
  }

  /** Ends the timeline at once. */
  private stop(end: End | "moved"): void {
    this.ended = end;
    if (end === "moved") page.replaceChildren();
    this.jsPsych?.abortExperiment();
  }

  private async play(session: Session, resumed: boolean): Promise<void> {
    page.replaceChildren();
    const jsPsych = initJsPsych({ display_element: "page", minimum_valid_rt: 0, override_safe_mode: true });
    this.jsPsych = jsPsych;
    const media = new Media((name) => this.transport.mediaUrl(name));
    const timeline = new Timeline({
      jsPsych,
      session,
      media,
      keep: async (seq, body) => {
        await this.outbox.put(session.token, seq, body);
        this.sender.start();
      },
      stop: (end) => this.stop(end),
      beginAnew: () => {
        // What the one before has not sent yet stays in the outbox, and is sent.
        this.memory.write({});
        location.reload();
      },
    }).build(resumed && session.done.length > 0);
    if (session.simulated) {
      const mode = this.link["mode"] === "visual" ? "visual" : "data-only";
      await jsPsych.simulate(timeline, mode, {});
    } else await jsPsych.run(timeline);
    if (this.ended === "moved") this.sayMoved(session);
    else await this.finish(session, this.ended ?? "complete");
  }

  /** The last page waits for the network, and only it. */
  private async finish(session: Session, end: End): Promise<void> {
    const texts = session.texts;
    this.tabs.release();
    show(`<p>${escaped(texts["page"].saving)}</p>`);
    const patience = setTimeout(() => this.offerFile(session), PATIENCE);
    const wait = waits();
    for (;;) {
      await this.sender.flushed();
      try {
        const entries = this.outbox.of(session.token);
        const said = await this.transport.finish(session.token, end, entries, this.tab);
        if (!said.missing.length) {
          clearTimeout(patience);
          if (said.state === "open" || said.state === "dropped") {
            this.sayMoved(session); // another tab has it, and goes on
            return;
          }
          await this.outbox.forget(session.token);
          const way = { code: said.code ?? "", redirect: said.redirect ?? "" };
          this.farewell(session, (said.state as End | undefined) ?? end, way);
          return;
        }
        this.sender.resend(session.token, said.missing);
      } catch (error) {
        if (error instanceof Refused) {
          clearTimeout(patience);
          this.offerFile(session, error.reason === "file" ? "file" : "offline");
          return;
        }
      }
      await pause(wait.next().value);
    }
  }

  private farewell(session: Session, end: End, way: Partial<Farewell>): void {
    const texts = session.texts;
    if (session.entry === "lab" || end === "declined") this.memory.write({});
    const parts = [
      end === "complete"
        ? pageOf(texts["end"].title, texts["end"].body)
        : `<p>${escaped(texts["stop"][end] ?? "")}</p>`,
    ];
    if (way.code)
      parts.push(`<p>${escaped(texts["end"].code)} <strong class="code">${escaped(way.code)}</strong></p>`);
    if (end === "complete") parts.push(`<p>${escaped(texts["end"].close)}</p>`);
    if (way.redirect) parts.push(`<p><a class="jspsych-btn">${escaped(texts["end"].redirect)}</a></p>`);
    show(parts.join(""));
    const link = page.querySelector("a");
    if (link && way.redirect && /^https?:/.test(way.redirect)) link.href = way.redirect;
    page.dataset["state"] = end;
  }

  private offerFile(session: Session, why: "offline" | "file" = "offline"): void {
    const texts = session.texts["end"];
    show(
      `<h1>${escaped(texts.title)}</h1><p>${escaped(texts[why])}</p>
       <p>${escaped(texts.offline_code)} <strong class="code">${escaped(session.code)}</strong></p>
       <p><a class="jspsych-btn" download="pourcast-${escaped(session.code)}.jsonl">${escaped(texts.download)}</a></p>`,
    );
    const content = lines(
      this.transport.opening(session),
      session.key,
      this.outbox.of(session.token),
    );
    const link = page.querySelector("a") as HTMLAnchorElement;
    link.href = URL.createObjectURL(new Blob([content], { type: "application/jsonl" }));
    page.dataset["state"] = why;
  }
}

/** Parameters of links, as `experiment/links.py` and recruiting platforms know them. */
const PARAMETERS = new Set([
  "lab", "preview", "simulation", "observer", "mode", "participant",
  "PROLIFIC_PID", "STUDY_ID", "SESSION_ID", "workerId", "assignmentId", "hitId",
]);

async function main(): Promise<void> {
  const given = [...new URLSearchParams(location.search)];
  const link = Object.fromEntries(given.filter(([name]) => PARAMETERS.has(name)));
  await new Study(await Outbox.open(), link).run();
}

void main();

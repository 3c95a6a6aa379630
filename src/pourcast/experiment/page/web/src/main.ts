/** The participant's page: begins or resumes a session, runs it, and ends when all is saved. */
import "./missing";
import "./page.css";

import { initJsPsych, type JsPsych } from "jspsych";

import { pause, waits } from "./backoff";
import { makeWord } from "./draws";
import { pressOnce } from "./keys";
import { Media } from "./media";
import { recall, remember } from "./memory";
import { Unreachable } from "./network";
import { Outbox } from "./outbox";
import { leaveFullScreen } from "./screen";
import { Sender } from "./sender";
import { Tabs } from "./tabs";
import { Timeline } from "./timeline";
import { makeTransport } from "./transports";
import { fileOf } from "./transports/records";
import { Refused, type Transport } from "./transports/transport";
import type { Body, End, Farewell, Session } from "./types";
import { escaped, fill, pageOf } from "./words";

/** How long the last page waits for the server before it offers the file [ms]. */
const PATIENCE = 20_000;

const page = document.getElementById("page") as HTMLElement;

/** Under what name sessions that were left are remembered. */
const LEFT = "pourcast left";

/** Words that the page itself brings, for when the server can't be reached. */
const words = page.dataset as { [name in "reaching" | "offline" | "silent" | "failing" | "broken"]: string };

function show(html: string): void {
  page.innerHTML = `<div class="text" role="status">${html}</div>`;
}

/** What this browser remembers of a link: which request it made, which token it got, how that ended. */
interface Visit {
  request?: string;
  token?: string;
  end?: End;
}

/** Why answers are not where they belong. */
type Trouble = { why: Unreachable["why"] | "refused" | "broken" | "file"; cause: string };

function troubleOf(error: unknown): Trouble {
  if (error instanceof Unreachable) return { why: error.why, cause: causeOf(error) };
  if (error instanceof Refused)
    return { why: error.reason === "file" ? "file" : "refused", cause: causeOf(error) };
  return { why: "broken", cause: causeOf(error) };
}

/** What happened, as part of a sentence; of a defect, what whoever reads it can tell us. */
function causeOf(error: unknown): string {
  if (error instanceof Unreachable) return error.message;
  const said = error instanceof Refused ? error.text || wordless(error) : String(error);
  return said.replace(/[.\s]+$/, "");
}

/** A refusal that came without words, as from a proxy: its status tells more than that it is one. */
function wordless({ reason, status }: Refused): string {
  return reason === "broken" ? `status ${status}` : `${reason}, status ${status}`;
}

/** Asks until somebody answers: for what passes alone, and saying what it is. */
async function patiently<T>(ask: () => Promise<T>): Promise<T> {
  const wait = waits();
  for (;;) {
    try {
      return await ask();
    } catch (error) {
      if (!(error instanceof Unreachable)) throw error;
      show(`<p>${escaped(fill(words[error.why], { cause: error.message }))}</p>`);
      await pause(wait.next().value);
    }
  }
}

class Study {
  private tab = makeWord();
  private key: string;
  private tabs: Tabs;
  private transport: Transport;
  private sender: Sender;
  private jsPsych: JsPsych | null = null;
  private ended: End | "moved" | null = null;
  private current: Session | null = null;
  /** What made it impossible to go on. */
  private fault: Error | null = null;
  /** Whether what the server lacks was sent a second time. */
  private resent = false;

  constructor(
    private outbox: Outbox,
    private link: { [name: string]: string },
  ) {
    this.key = `pourcast ${new URLSearchParams(link).toString()}`;
    this.tabs = new Tabs(this.tab, this.key);
    this.transport = makeTransport(link);
    this.sender = new Sender(outbox, this.transport, this.tab);
  }

  async run(): Promise<void> {
    try {
      await this.visit();
    } catch (error) {
      this.giveUp(error);
    }
  }

  private async visit(): Promise<void> {
    // What an earlier visit could not send, whosever it was.
    this.sender.start();
    void this.endThoseLeft();
    const elsewhere = await this.tabs.elsewhere();
    // Whether there was a session before this page: it goes on.
    let [session, resumed] = await this.session();
    this.current = session;
    document.title = session.texts["page"].title;
    if (session.state !== "open") {
      this.farewell(session, session.state as End, session);
      this.offerAnew(session);
      return;
    }
    if (elsewhere) await this.askWhere(session);
    this.tabs.onTaken = () => this.moveAway(session);
    this.tabs.take();
    // Only now, as the other tab may have answered until it was told.
    if (elsewhere || resumed) session = this.current = await this.known(session.token, this.tab);
    this.sender.onSuperseded = (token) => {
      if (token === session.token) this.moveAway(session);
    };
    const end = this.endOf(session);
    if (end) await this.finish(session, end);
    else await this.play(session, resumed);
  }

  /** How a session ended before this page was loaded, if nothing is left but to say so. */
  private endOf(session: Session): End | undefined {
    const done = new Set(session.done);
    if (session.steps.every((step) => done.has(step.seq))) return "complete";
    const { end } = this.memory;
    return end === "complete" ? undefined : end;
  }

  /** Where there is no way on: says why, and offers what was answered. */
  private giveUp(error: unknown): void {
    const trouble = troubleOf(error);
    const session = this.current;
    if (session && this.outbox.of(session.token).length) this.offerFile(session, trouble);
    else if (error instanceof Refused && error.text) show(`<p>${escaped(error.text)}</p>`);
    else show(`<p>${escaped(fill(words.broken, { cause: trouble.cause }))}</p>`);
  }

  private get memory(): Visit {
    return recall(this.key) ?? {};
  }

  private set memory(visit: Visit) {
    remember(this.key, visit);
  }

  /** The session, and whether it goes on; no other tab is told yet. */
  private async session(): Promise<[Session, boolean]> {
    const known = this.memory;
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
    this.memory = { request };
    const session = await patiently(() => this.transport.begin(request, this.tab));
    this.memory = { request, token: session.token };
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
      keep: (seq, body) => this.keep(session, seq, body),
      stop: (end) => this.stop(end),
      beginAnew: () => this.beginAnew(),
    }).build(resumed && session.done.length > 0);
    if (session.simulated) {
      const mode = this.link["mode"] === "visual" ? "visual" : "data-only";
      await jsPsych.simulate(timeline, mode, {});
    } else await jsPsych.run(timeline);
    await leaveFullScreen();
    if (this.fault) throw this.fault;
    if (this.ended === "moved") this.sayMoved(session);
    else await this.finish(session, this.ended ?? "complete");
  }

  /** Keeps a record in the browser; from there it is sent. A page that can't do that is ended. */
  private async keep(session: Session, seq: number, body: Body): Promise<void> {
    try {
      await this.outbox.put(session.token, seq, body);
      this.sender.start();
    } catch (error) {
      this.fault = error instanceof Error ? error : new Error(String(error));
      this.jsPsych?.abortExperiment();
    }
  }

  private beginAnew(): void {
    // What the one before has not sent yet stays in the outbox, and is sent; so is how it ended.
    const { token, end } = this.memory;
    if (token && end && this.outbox.of(token).length) remember(LEFT, { ...this.left, [token]: end });
    this.memory = {};
    location.reload();
  }

  /** How sessions ended that somebody left at this computer before that could be told. */
  private get left(): { [token: string]: End } {
    return (recall(LEFT) ?? {}) as { [token: string]: End };
  }

  /** Ends them, once all their records are sent; who can't be reached is asked by the next page. */
  private async endThoseLeft(): Promise<void> {
    for (const [token, end] of Object.entries(this.left)) {
      await this.sender.flushed();
      const entries = this.outbox.of(token);
      const said = await this.transport.finish(token, end, entries, this.tab).catch(() => null);
      if (!said || said.missing.length) continue;
      await this.outbox.forget(token);
      const { [token]: done, ...others } = this.left;
      if (done) remember(LEFT, others);
    }
  }

  /** The last page waits for the network, and only it. */
  private async finish(session: Session, end: End): Promise<void> {
    // A page that is loaded again waits on, and asks nothing more.
    this.memory = { ...this.memory, end };
    this.tabs.release();
    show(`<p>${escaped(session.texts["page"].saving)}</p>`);
    let trouble = new Unreachable("silent", "");
    const offer = () => this.offerFile(session, troubleOf(this.sender.trouble ?? trouble));
    const patience = setTimeout(offer, PATIENCE);
    const wait = waits();
    try {
      while (!(await this.isOver(session, end, (met) => (trouble = met)))) await pause(wait.next().value);
    } finally {
      clearTimeout(patience);
    }
  }

  /** Whether a session's end, and all that belongs to it, are where they belong. */
  private async isOver(session: Session, end: End, met: (trouble: Unreachable) => void): Promise<boolean> {
    await this.sender.flushed();
    try {
      const entries = this.outbox.of(session.token);
      const said = await this.transport.finish(session.token, end, entries, this.tab);
      if (said.missing.length) return this.supply(session, said.missing);
      if (said.state === "open" || said.state === "dropped") {
        this.sayMoved(session); // another tab has it, and goes on
        return true;
      }
      await this.outbox.forget(session.token);
      const way = { code: said.code ?? "", redirect: said.redirect ?? "" };
      this.farewell(session, (said.state as End | undefined) ?? end, way);
      return true;
    } catch (error) {
      if (!(error instanceof Unreachable)) throw error;
      met(error);
      return false;
    }
  }

  /** Sends what is missing once more. What is not here either is asked again. */
  private supply(session: Session, missing: number[]): false {
    const refusal = this.sender.refusal(session.token);
    if (refusal && this.resent) throw refusal;
    const own = this.outbox.of(session.token);
    if (!own.some((entry) => missing.includes(entry.seq))) location.reload();
    this.resent = true;
    this.sender.resend(session.token, missing);
    return false;
  }

  private farewell(session: Session, end: End, way: Partial<Farewell>): void {
    const texts = session.texts;
    if (session.entry === "lab" || end === "declined") this.memory = {};
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

  /** The answers as a file, and what became of them. */
  private offerFile(session: Session, { why, cause }: Trouble): void {
    const texts = session.texts["end"];
    const isTrying = why === "offline" || why === "silent" || why === "failing";
    const parts = [
      why === "file" ? "" : fill(texts[why], { cause }),
      this.outbox.survives ? texts.kept : texts.kept_in_page,
      isTrying ? texts.meanwhile : texts.file,
    ];
    const said = parts.filter(Boolean).map((part) => `<p>${escaped(part)}</p>`);
    show(
      `<h1>${escaped(texts.title)}</h1>${said.join("")}
       <p>${escaped(texts.offline_code)} <strong class="code">${escaped(session.code)}</strong></p>
       <p><a class="jspsych-btn" download="pourcast-${escaped(session.code)}.json">${escaped(texts.download)}</a></p>`,
    );
    const file = fileOf(
      this.transport.opening(session),
      session.steps,
      this.outbox.of(session.token),
    );
    const link = page.querySelector("a") as HTMLAnchorElement;
    link.href = URL.createObjectURL(new Blob([file], { type: "application/json" }));
    page.dataset["state"] = why;
    if (this.outbox.survives) this.offerAnew(session);
  }

  /** At a computer that several people use, the next one can begin. */
  private offerAnew(session: Session): void {
    const isShared = session.entry === "lab" || session.entry === "preview" || !Object.keys(this.link).length;
    if (!isShared) return;
    const button = document.createElement("button");
    button.className = "jspsych-btn";
    button.textContent = session.texts.resume.anew;
    button.addEventListener("click", () => this.beginAnew());
    page.firstElementChild?.append(button);
  }
}

/** Parameters of links, as `experiment/links.py` and recruiting platforms know them. */
const PARAMETERS = new Set([
  "lab", "preview", "simulation", "observer", "mode", "participant",
  "PROLIFIC_PID", "STUDY_ID", "SESSION_ID", "workerId", "assignmentId", "hitId",
]);

async function main(): Promise<void> {
  // start.ts has said that this browser is too old.
  if (!("replaceChildren" in page)) return;
  show(`<p>${escaped(words.reaching)}</p>`);
  document.addEventListener("keydown", pressOnce, true);
  try {
    const given = [...new URLSearchParams(location.search)];
    const link = Object.fromEntries(given.filter(([name]) => PARAMETERS.has(name)));
    await new Study(await Outbox.open(), link).run();
  } catch (error) {
    show(`<p>${escaped(fill(words.broken, { cause: causeOf(error) }))}</p>`);
  }
}

void main();

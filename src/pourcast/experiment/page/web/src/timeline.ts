/** From a session's steps to jsPsych's timeline. */
import browserCheck from "@jspsych/plugin-browser-check";
import callFunction from "@jspsych/plugin-call-function";
import buttons from "@jspsych/plugin-html-button-response";
import type { JsPsych } from "jspsych";

import type { Media } from "./media";
import film from "./plugins/film";
import form from "./plugins/form";
import slider from "./plugins/slider";
import { canFill, fillScreen, isFull } from "./screen";
import type { Question } from "./texts";
import type { Body, End, Session, Step } from "./types";
import { Watch } from "./watch";
import { escaped, fill, pageOf, paragraphs } from "./words";

/** A trial, or trials in a row, as jsPsych describes them. */
type Node = Exclude<Extract<Parameters<JsPsych["run"]>[0], unknown[]>[number], unknown[]>;

/** What a plugin has found: its data, which jsPsych doesn't know the types of. */
interface Found {
  response?: number | null;
  rt?: number | null;
  [column: string]: unknown;
}

const SLOW = 8000;

/** What the timeline needs of the page around it. */
export interface Surroundings {
  jsPsych: JsPsych;
  session: Session;
  media: Media;
  /** Keeps a step's record; resolves when it is on the disk. */
  keep: (seq: number, body: Body) => Promise<void>;
  /** Ends the study before its end. */
  stop: (end: End) => void;
  /** Forgets the session, for somebody else at the same computer. */
  beginAnew: () => void;
}

export class Timeline {
  /** What the page that asks for full screen says: it is new, was left, or refused by the browser. */
  private asking: "body" | "left" | "refused" = "body";
  /** The participant goes on without full screen, which the browser refused. */
  private inWindow = false;

  constructor(private around: Surroundings) {}

  /** All that is still to be done; `resumed` begins with a word of welcome. */
  build(resumed: boolean): Node[] {
    const { session } = this.around;
    const done = new Set(session.done);
    const steps = session.steps.filter((step) => !done.has(step.seq));
    this.preloadNext(steps);
    return [
      ...(resumed ? [this.welcomeBack()] : []),
      ...steps.flatMap((step) => this.step(step)),
    ];
  }

  private get texts() {
    return this.around.session.texts;
  }

  private step(step: Step): Node[] {
    switch (step.kind) {
      case "consent":
        return this.consent(step);
      case "check":
        return this.check(step);
      case "instructions":
        return this.instructions(step);
      case "judgment":
        return this.judgment(step);
      case "film":
        return step.film ? this.film(step) : [];
      case "break":
        return this.breaks(step);
      case "debrief":
        return this.debrief(step);
    }
  }

  /**
   * A page with buttons. ENTER goes on by the last one, which has the focus, or a notice above it.
   * `chosen` is told the number of the button; `pressed` hears of the last one as it is pressed.
   */
  private page(
    html: string | (() => string),
    choices: string[],
    chosen: (button: number) => void = () => undefined,
    { pressed, ...extra }: { pressed?: () => void; [parameter: string]: unknown } = {},
  ): Node {
    let watch: Watch | undefined;
    const content = typeof html === "string" ? () => html : html;
    return {
      type: buttons,
      stimulus: () => `<div class="text">${content()}</div>`,
      choices: choices.map(escaped),
      on_load: () => {
        watch = new Watch();
        const all = document.querySelectorAll<HTMLElement>("#page button");
        const last = all[all.length - 1];
        // On the way down to the button: the page goes on as soon as the button itself has heard.
        last?.parentElement?.addEventListener("click", (event) => event.target === last && pressed?.(), true);
        const notice = document.querySelector<HTMLElement>("#page .notice");
        (notice ?? last)?.focus();
        notice?.addEventListener("keydown", (event) => {
          if (event.key !== "Enter") return;
          event.preventDefault(); // The next page's button has the focus before this key's work is done.
          if (!event.repeat) last?.click();
        });
      },
      on_finish: (data: Found) => {
        Object.assign(data, watch?.stop(), { rt: (data.rt ?? 0) / 1000 });
        if (typeof data.response === "number") chosen(data.response);
      },
      ...extra,
    };
  }

  /** Keeps what the trial before has found, and only then goes on. */
  private keep(step: Step, body: (last: Found) => Body = () => ({})): Node {
    return {
      type: callFunction,
      async: true,
      func: (done: () => void) => {
        const [last = {}] = this.around.jsPsych.data.get().last(1).values() as Found[];
        const watched = {
          rt: last.rt ?? 0,
          window_width: last.window_width ?? window.innerWidth,
          window_height: last.window_height ?? window.innerHeight,
          focus_losses: last.focus_losses ?? 0,
          dropped_frames: last.dropped_frames ?? 0,
        };
        void this.around.keep(step.seq, { ...watched, ...body(last) }).then(done);
      },
    };
  }

  private welcomeBack(): Node {
    const { session } = this.around;
    const trials = session.steps.filter((step) => step.kind === "judgment");
    const done = trials.filter((step) => session.done.includes(step.seq)).length;
    const text = fill(this.texts.resume.body, { done, count: trials.length });
    const { title, anew, button } = this.texts.resume;
    const shared = session.entry === "lab" || session.entry === "preview";
    return this.page(pageOf(title, text), shared ? [anew, button] : [button], (chosen) => {
      if (shared && chosen === 0) this.around.beginAnew();
    });
  }

  /** What steps with pictures need: full screen, and room. Asked for again when it is gone. */
  private screen(tried: () => void = () => undefined): Node[] {
    const { session } = this.around;
    // A browser lets nobody but a person fill the screen.
    const fills = session.fullscreen && !session.simulated && canFill();
    return [...(fills ? [this.fullscreen()] : []), this.room(tried)];
  }

  private fullscreen(): Node {
    const texts = this.texts.fullscreen;
    let filled = Promise.resolve();
    const page = this.page(
      () => pageOf(texts.title, texts[this.asking]),
      [],
      (chosen) => (this.inWindow = this.asking === "refused" && chosen === 0),
      {
        choices: () => (this.asking === "refused" ? [texts.without, texts.button] : [texts.button]).map(escaped),
        // In the press itself: a moment later a browser may refuse.
        pressed: () => void (filled = fillScreen()),
      },
    );
    const wanted = () => !this.inWindow && !isFull();
    const wait: Node = {
      type: callFunction,
      async: true,
      func: (done: () => void) =>
        void filled.then(() => {
          this.asking = isFull() ? "left" : "refused";
          done();
        }),
    };
    return { timeline: [page, wait], conditional_function: wanted, loop_function: wanted };
  }

  /** A window that the picture fits in. */
  private room(tried: () => void): Node {
    const { session } = this.around;
    const texts = this.texts.check;
    const small = () =>
      window.innerWidth < session.minimum_width || window.innerHeight < session.minimum_height;
    const tooSmall = () =>
      pageOf(
        texts.title,
        fill(texts.too_small, {
          width: window.innerWidth,
          height: window.innerHeight,
          need_width: session.minimum_width,
          need_height: session.minimum_height,
        }),
      );
    const page = this.page(tooSmall, [texts.leave, texts.again], (chosen) => {
      tried();
      if (chosen === 0) this.around.stop("screened_out");
    });
    return { timeline: [page], conditional_function: small, loop_function: small };
  }

  private consent(step: Step): Node[] {
    const texts = this.texts.consent;
    const { session } = this.around;
    const contact = session.contact ? `\n\n${fill(texts.contact, { contact: session.contact })}` : "";
    const body = `${fill(texts.body, { minutes: session.minutes })}${contact}\n\n${texts.agree}`;
    const page = this.page(
      pageOf(texts.title, body),
      [texts.decline_button, texts.agree_button],
      (chosen) => {
        if (chosen === 0) this.around.stop("declined");
      },
      { simulation_options: { data: { response: 1 } } },
    );
    return [page, this.keep(step)];
  }

  private check(step: Step): Node[] {
    let tries = 1;
    let found: { browser?: string; browser_version?: string; os?: string; mobile?: boolean; vsync_rate?: number } = {};
    return [
      ...this.screen(() => (tries += 1)),
      {
        type: browserCheck,
        skip_features: ["webaudio", "webcam", "microphone"],
        vsync_frame_count: 30,
        allow_window_resize: false,
        simulation_options: { simulate: false },
        on_finish: (data: typeof found) => (found = { ...data }),
      },
      this.keep(step, () => ({
        browser: found.browser ?? "",
        browser_version: found.browser_version ?? "",
        system: found.os ?? "",
        mobile: Boolean(found.mobile),
        refresh_rate: Number.isFinite(found.vsync_rate) ? found.vsync_rate : null,
        language: navigator.language,
        tries,
      })),
    ];
  }

  private instructions(step: Step): Node[] {
    const { session } = this.around;
    const pages = this.instructionPages();
    const questions = this.texts.goal.quiz;
    const quiz = this.texts.quiz;
    const attempts: number[][] = [];
    const began = performance.now();
    let at = 0;
    let wrong: Question[] = questions;
    const { back, continue: onward } = this.texts.page;
    const reading = this.page(
      () => (at || !attempts.length ? "" : this.wrongAnswers(wrong, attempts.length)) + (pages[at] as string),
      [],
      (chosen) => (at += at && chosen === 0 ? -1 : 1),
      {
        choices: () => (at ? [back, onward] : [onward]).map(escaped),
        simulation_options: { data: { response: () => (at ? 1 : 0) } },
      },
    );
    const asking: Node = {
      type: form,
      title: quiz.title,
      body: quiz.body,
      questions,
      button: quiz.button,
      on_finish: (data: { choices: number[] }) => {
        attempts.push(data.choices);
        wrong = questions.filter((one, k) => data.choices[k] !== one.right);
      },
    };
    return [
      ...this.screen(),
      {
        timeline: [{ timeline: [reading], loop_function: () => at < pages.length }, asking],
        loop_function: () => {
          at = 0;
          return wrong.length > 0 && attempts.length < session.comprehension_attempts;
        },
      },
      this.keep(step, () => ({ attempts, rt: (performance.now() - began) / 1000 })),
      {
        type: callFunction,
        func: () => {
          if (wrong.length) this.around.stop("failed_check");
        },
      },
    ];
  }

  /** What stands above the instructions when questions about them were answered wrongly. */
  private wrongAnswers(wrong: Question[], attempts: number): string {
    const { quiz } = this.texts;
    const left = this.around.session.comprehension_attempts - attempts;
    const asked = wrong.map((one) => `<li>${escaped(one.question)}</li>`).join("");
    const after = paragraphs(fill(quiz.again, { left }));
    return `<div class="notice" role="alert" tabindex="-1">${paragraphs(quiz.wrong)}<ul>${asked}</ul>${after}</div>`;
  }

  private instructionPages(): string[] {
    const { session } = this.around;
    const texts = this.texts.instructions;
    const trials = session.steps.filter((step) => step.kind === "judgment");
    const count = (phase: string) => trials.filter((step) => step.phase === phase).length;
    const liquids = [...new Set(trials.map((step) => step.liquid as string))].sort().reverse();
    const practised = count("practice") > 0;
    const counts = { practice: count("practice"), test: count("test"), blocks: this.blocks() };
    const films = practised ? [texts.end.practice, texts.end.test] : [texts.end.test_alone];
    const end = [texts.end.answer, fill(films.join(" "), counts)].join("\n\n");
    const bodies = [...this.texts.goal.instructions, end];
    bodies[0] += `\n\n${liquids.map((liquid) => this.texts.liquids[liquid]?.description ?? "").join(" ")}`;
    return bodies.map((body) => pageOf(texts.title, body));
  }

  private blocks(): number {
    return 1 + this.around.session.steps.filter((step) => step.kind === "break").length;
  }

  /** Waits for a file, with a word if that takes long. */
  private fetched(name: () => string, put: (url: string) => void): Node {
    return {
      type: callFunction,
      async: true,
      func: (done: () => void) => {
        const { page } = this.texts;
        const holder = document.createElement("p");
        holder.className = "waiting";
        holder.setAttribute("role", "status");
        const soon = setTimeout(() => (holder.textContent = page.loading), 500);
        const late = setTimeout(() => {
          const missing = this.around.media.lacks(name());
          holder.textContent = missing ? page.loading_missing : page.loading_slow;
        }, SLOW);
        this.around.jsPsych.getDisplayElement().replaceChildren(holder);
        void this.around.media.get(name()).then((url) => {
          clearTimeout(soon);
          clearTimeout(late);
          put(url);
          done();
        });
      },
    };
  }

  private count(step: Step): string {
    const same = this.around.session.steps.filter(
      (one) => one.kind === "judgment" && one.phase === step.phase,
    );
    const text = step.phase === "practice" ? this.texts.trial.practice : this.texts.trial.test;
    return fill(text, { number: step.trial ?? 0, count: same.length });
  }

  private judgment(step: Step): Node[] {
    const { session } = this.around;
    const texts = this.texts.trial;
    const own = this.texts.goal;
    const liquid = step.liquid ?? "";
    let url = "";
    const words = {
      progress: this.count(step),
      question: fill(own.question, { liquid: this.texts.liquids[liquid]?.name ?? liquid }),
      picture: texts.picture,
      slider: own.slider,
      low: own.low,
      high: own.high,
      value: own.value,
      unset: texts.unset,
      set: texts.set,
      button: texts.button,
    };
    const answer = session.simulated?.[String(step.seq)];
    return [
      ...this.screen(),
      this.fetched(() => step.still as string, (found) => (url = found)),
      {
        type: slider,
        stimulus: () => url,
        aspect: session.aspect,
        answer_picture: session.answer_picture,
        colour: session.colours[liquid] ?? "#2978cc",
        words,
        ...session.slider,
        simulation_options: { data: answer ?? {} },
      },
      this.keep(step, (last) => ({
        stimulus: step.still,
        response: last.response,
        picture_width: last.picture_width,
        picture_height: last.picture_height,
        pixel_ratio: last.pixel_ratio,
        start: last.start,
        first_move: last.first_move,
        moves: last.moves,
        input: last.input,
        trajectory: last.trajectory,
      })),
    ];
  }

  private film(step: Step): Node[] {
    const { session } = this.around;
    const texts = this.texts.film;
    const words = {
      progress: this.count(step),
      title: texts.title,
      picture: texts.picture,
      unplayable: texts.unplayable,
      blocked: texts.blocked,
      play: texts.play,
      button: this.texts.page.continue,
    };
    let url = "";
    return [
      ...this.screen(),
      this.fetched(() => step.film as string, (found) => (url = found)),
      { type: film, stimulus: () => url, aspect: session.aspect, words },
      this.keep(step, (last) => ({ stimulus: step.film, played: last.played, stalls: last.stalls })),
      ...(this.isLastOfPractice(step) ? [this.practiceEnd()] : []),
    ];
  }

  private isLastOfPractice(step: Step): boolean {
    const next = this.around.session.steps[step.seq + 1];
    return next?.phase !== "practice";
  }

  private practiceEnd(): Node {
    const test = this.around.session.steps.filter((step) => step.kind === "judgment" && step.phase === "test");
    const texts = this.texts.practice_end;
    return this.page(pageOf(texts.title, fill(texts.body, { test: test.length })), [texts.button]);
  }

  private breaks(step: Step): Node[] {
    const texts = this.texts.break;
    const text = fill(texts.body, { block: step.block ?? 0, blocks: this.blocks() });
    const page = this.page(pageOf(texts.title, text), [texts.button], undefined, {
      on_start: () => this.preloadBlock((step.block ?? 0) + 1),
    });
    return [page, this.keep(step)];
  }

  private debrief(step: Step): Node[] {
    const texts = this.texts.debrief;
    return [
      { type: form, title: texts.title, body: texts.body, label: texts.label, button: texts.button },
      this.keep(step, (last) => ({ remarks: last.text ?? "" })),
    ];
  }

  /** Fetches what comes first: the practice's films, then the next block's pictures. */
  private preloadNext(steps: Step[]): void {
    const practice = steps.filter((step) => step.phase === "practice");
    const films = practice.filter((step) => step.kind === "film").map((step) => step.film ?? "");
    const stills = practice.filter((step) => step.kind === "judgment").map((step) => step.still ?? "");
    const first = stills.flatMap((still, k) => [still, films[k] ?? ""]);
    this.around.media.preload([...first, ...films]);
    const next = steps.find((step) => step.kind === "judgment" && step.phase === "test");
    if (next) this.preloadBlock(next.block ?? 1);
  }

  private preloadBlock(block: number): void {
    const steps = this.around.session.steps.filter(
      (step) => step.kind === "judgment" && step.block === block && !this.around.session.done.includes(step.seq),
    );
    this.around.media.preload(steps.map((step) => step.still ?? ""));
  }
}

/** Posts what is in the outbox, one record after another, until the server has all of it. */
import { waits } from "./backoff";
import type { Entry, Outbox } from "./outbox";
import { Refused, type Transport } from "./transports/transport";

const LONGEST_WAIT = 15_000;

export class Sender {
  private running = false;
  private wake: () => void = () => undefined;
  private idle: (() => void)[] = [];
  private refused = new Map<Entry, Refused>();
  /** Why what waits was not sent when it was tried last; nothing, when it was. */
  trouble: unknown = undefined;

  /** Called when another tab has the session; not for what was posted before this was set. */
  onSuperseded: (session: string) => void = () => undefined;

  constructor(
    private outbox: Outbox,
    private transport: Transport,
    private tab: string,
  ) {
    const now = () => this.wake();
    window.addEventListener("online", now);
    document.addEventListener("visibilitychange", now);
  }

  /** Looks for records to be sent; returns at once. */
  start(): void {
    if (!this.running) void this.run();
  }

  /** Resolves when all is sent. */
  async flushed(): Promise<void> {
    this.start();
    if (this.running) await new Promise<void>((resolve) => this.idle.push(resolve));
  }

  /** Takes up again what the server lacks, even what was refused: it may have been a proxy's no. */
  resend(session: string, missing: number[]): void {
    this.outbox.markUnsaved(session, missing);
    for (const entry of this.outbox.of(session))
      if (missing.includes(entry.seq)) this.refused.delete(entry);
  }

  /** Why a record of a session was refused for good, if one was. */
  refusal(session: string): Refused | undefined {
    return [...this.refused].find(([entry]) => entry.session === session)?.[1];
  }

  private next(): Entry | undefined {
    return this.outbox.unsaved().find((entry) => !this.refused.has(entry));
  }

  private async run(): Promise<void> {
    this.running = true;
    let wait = waits(LONGEST_WAIT);
    for (let entry = this.next(); entry; entry = this.next()) {
      // An answer that comes late, after this tab took the session over, tells of the time before.
      const { onSuperseded } = this;
      try {
        const said = await this.transport.save(entry.session, entry.seq, entry.body, this.tab);
        await this.outbox.markSaved(entry);
        if (said.superseded) onSuperseded(entry.session);
        wait = waits(LONGEST_WAIT);
        this.trouble = undefined;
      } catch (error) {
        this.trouble = error;
        // Whoever is refused stays in the browser, for the file; all others are tried for ever.
        if (error instanceof Refused && error.status !== 429) this.refused.set(entry, error);
        else await this.pause(wait.next().value);
      }
    }
    this.running = false;
    this.idle.splice(0).forEach((resolve) => resolve());
  }

  private pause(longest: number): Promise<void> {
    // A random part, or all participants come at once when the server is back.
    const length = longest * (0.5 + Math.random() / 2);
    return new Promise((resolve) => {
      const timer = setTimeout(resolve, length);
      this.wake = () => {
        clearTimeout(timer);
        resolve();
      };
    });
  }
}

/** Two tabs of one participant: the later one is told of the earlier, and may take over. */

const PATIENCE = 400;

type Said = { kind: "anybody" | "here" | "mine"; tab: string; key: string };

export class Tabs {
  private channel: BroadcastChannel | null;
  private holds = false;
  private answered: () => void = () => undefined;

  /** Called when another tab took over. */
  onTaken: () => void = () => undefined;

  constructor(
    private tab: string,
    private key: string,
  ) {
    this.channel = "BroadcastChannel" in window ? new BroadcastChannel("pourcast") : null;
    this.channel?.addEventListener("message", (event) => this.heard(event.data as Said));
  }

  /** Whether another tab has the study open. */
  elsewhere(): Promise<boolean> {
    if (!this.channel) return Promise.resolve(false);
    return new Promise((resolve) => {
      const timer = setTimeout(() => resolve(false), PATIENCE);
      this.answered = () => {
        clearTimeout(timer);
        resolve(true);
      };
      this.say("anybody");
    });
  }

  /** Says that this tab has the study now. */
  take(): void {
    this.holds = true;
    this.say("mine");
  }

  release(): void {
    this.holds = false;
  }

  private heard(said: Said): void {
    if (said.key !== this.key || said.tab === this.tab) return;
    if (said.kind === "anybody" && this.holds) this.say("here");
    if (said.kind === "here") this.answered();
    if (said.kind === "mine" && this.holds) {
      this.holds = false;
      this.onTaken();
    }
  }

  private say(kind: Said["kind"]): void {
    this.channel?.postMessage({ kind, tab: this.tab, key: this.key } satisfies Said);
  }
}

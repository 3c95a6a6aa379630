/** Two tabs of one participant: the later one is told of the earlier, and may take over. */
import { forget, remember } from "./memory";

const PATIENCE = 400;

type Said = { kind: "anybody" | "here" | "mine"; tab: string; key: string; at: number };

export class Tabs {
  private post: (said: Said) => void;
  private holds = false;
  /** When this tab took the study [ms]: messages may cross, or come late to a tab that sleeps. */
  private at = 0;
  /** When any tab took it, as far as this one has heard. */
  private latest = 0;
  private answered: () => void = () => undefined;

  /** Called when another tab took over. */
  onTaken: () => void = () => undefined;

  constructor(
    private tab: string,
    private key: string,
  ) {
    this.post = openChannel((said) => this.heard(said));
  }

  /** Whether another tab has the study open. */
  elsewhere(): Promise<boolean> {
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
    // Later than all that was heard of, even if the clock has not moved on since, or was set back.
    this.at = this.latest = Math.max(Date.now(), this.latest + 1);
    this.say("mine");
  }

  release(): void {
    this.holds = false;
  }

  private heard(said: Said): void {
    if (said.key !== this.key || said.tab === this.tab) return;
    if (said.kind === "anybody" && this.holds) this.say("here");
    if (said.kind === "here") this.answered();
    if (said.kind === "mine") this.hearOfTaking(said);
  }

  /** Of two tabs that took the study at once, one keeps it: the same in the eyes of both. */
  private hearOfTaking(said: Said): void {
    this.latest = Math.max(this.latest, said.at);
    const later = said.at > this.at || (said.at === this.at && said.tab > this.tab);
    if (!this.holds || !later) return;
    this.holds = false;
    this.onTaken();
  }

  private say(kind: Said["kind"]): void {
    this.post({ kind, tab: this.tab, key: this.key, at: this.at });
  }
}

const NAME = "pourcast";

/** How a tab speaks to the others; `heard` is told what they say. */
function openChannel(heard: (said: Said) => void): (said: Said) => void {
  try {
    const channel = new BroadcastChannel(NAME);
    channel.addEventListener("message", (event) => heard(event.data as Said));
    return (said) => {
      // It is no window, and has no other origin.
      // oxlint-disable-next-line unicorn/require-post-message-target-origin
      channel.postMessage(said);
    };
  } catch {
    return openStorage(heard);
  }
}

/**
 * The same through local storage, which tells other tabs of its changes: Safari before 15.4 has no
 * channels. Where cookies are blocked nobody hears anything: then the server alone tells two tabs.
 */
function openStorage(heard: (said: Said) => void): (said: Said) => void {
  const name = `${NAME} tabs`;
  window.addEventListener("storage", (event) => {
    if (event.key === name && event.newValue) heard(JSON.parse(event.newValue) as Said);
  });
  return (said) => {
    remember(name, said);
    // Or the same words, said once more, would be no change.
    forget(name);
  };
}

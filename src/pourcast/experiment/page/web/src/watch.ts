/** What disturbed a step: lost focus, pictures that came too late. */

import { ParameterType } from "jspsych";

/** The columns of what a watch tells, as plugins declare their data. */
export const WATCHED = {
  /** Size of the window [points]. */
  window_width: { type: ParameterType.FLOAT },
  window_height: { type: ParameterType.FLOAT },
  /** How often the page lost the focus. */
  focus_losses: { type: ParameterType.INT },
  /** Pictures that the screen did not show in time. */
  dropped_frames: { type: ParameterType.INT },
} as const;

export interface Watched {
  window_width: number;
  window_height: number;
  focus_losses: number;
  dropped_frames: number;
}

/** Watches until `stop` is called, which tells what was seen. */
export class Watch {
  private focusLosses = 0;
  private dropped = 0;
  private last = 0;
  private request = 0;
  private away = false;

  constructor() {
    window.addEventListener("blur", this.left);
    window.addEventListener("focus", this.back);
    document.addEventListener("visibilitychange", this.turned);
    this.request = requestAnimationFrame(this.frame);
  }

  stop(): Watched {
    cancelAnimationFrame(this.request);
    window.removeEventListener("blur", this.left);
    window.removeEventListener("focus", this.back);
    document.removeEventListener("visibilitychange", this.turned);
    return {
      window_width: window.innerWidth,
      window_height: window.innerHeight,
      focus_losses: this.focusLosses,
      dropped_frames: this.dropped,
    };
  }

  private left = () => {
    if (!this.away) this.focusLosses += 1;
    this.away = true;
  };

  private back = () => {
    this.away = false;
  };

  private turned = () => {
    if (document.hidden) this.left();
    else {
      this.back();
      this.last = 0; // A hidden page is drawn by nobody: nothing was dropped.
    }
  };

  private frame = (now: number) => {
    // Screens draw 60 times a second or more often; a gap of two pictures' length is one lost.
    if (this.last) this.dropped += Math.max(0, Math.round((now - this.last) / (1000 / 60)) - 1);
    this.last = now;
    this.request = requestAnimationFrame(this.frame);
  };
}

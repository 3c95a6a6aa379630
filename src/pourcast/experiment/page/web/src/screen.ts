/** The screen: filled, left again, and how large a picture it has room for. */

/** Safari before 16.4 has these under other names, and its request tells of no success. */
type Page = Partial<Pick<Document, "fullscreenElement" | "fullscreenEnabled" | "exitFullscreen">> & {
  webkitFullscreenElement?: Element | null;
  webkitFullscreenEnabled?: boolean;
  webkitExitFullscreen?: () => void;
};
type Root = Partial<Pick<HTMLElement, "requestFullscreen">> & { webkitRequestFullscreen?: () => void };

/** How long a window must keep its size to have its last one; full screen comes in slowly [ms]. */
const STILL = 300;
const LONGEST = 3000;
const LOOK = 50;

/** Whether the browser can fill the screen with the page at all. */
export function canFill(): boolean {
  const page: Page = document;
  return page.fullscreenEnabled ?? page.webkitFullscreenEnabled ?? false;
}

/** Whether the page fills the screen. */
export function isFull(): boolean {
  const page: Page = document;
  return Boolean(page.fullscreenElement ?? page.webkitFullscreenElement);
}

/** Asks to fill the screen, which only a press of a button or key may do; waits for its last size. */
export async function fillScreen(): Promise<void> {
  const root: Root = document.documentElement;
  try {
    await (root.requestFullscreen ? root.requestFullscreen() : root.webkitRequestFullscreen?.());
  } catch {
    // Refused: `isFull` tells.
  }
  await settled();
}

/** Gives the screen back. */
export async function leaveFullScreen(): Promise<void> {
  if (!isFull()) return;
  const page: Page = document;
  try {
    await (page.exitFullscreen ? page.exitFullscreen() : page.webkitExitFullscreen?.());
  } catch {
    // It was left just now.
  }
}

function size(): string {
  return `${window.innerWidth} ${window.innerHeight} ${isFull()}`;
}

async function settled(): Promise<void> {
  let last = size();
  let still = 0;
  for (let waited = 0; waited < LONGEST && still < STILL; waited += LOOK) {
    await new Promise((resolve) => setTimeout(resolve, LOOK));
    still = size() === last ? still + LOOK : 0;
    last = size();
  }
}

/** What the page of a trial needs beside the picture, above what page.css takes it to need [points]. */
let more = 0;
/** The window for which that is known. */
let known = "";

/**
 * Makes the picture smaller by what does not fit in the window: a long question, large letters.
 * In a window of the same size it stays so, as a film and the next pictures must be as large.
 */
export function fitPicture(): void {
  const root = document.documentElement;
  const put = () => root.style.setProperty("--more", `${more}px`);
  if (size() !== known) {
    known = size();
    more = 0;
    put();
  }
  more += Math.max(0, root.scrollHeight - root.clientHeight);
  put();
}

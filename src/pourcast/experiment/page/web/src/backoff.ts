/** How long to wait before something is tried again. */

const FIRST = 500;

/** Waits [ms], each twice as long as the one before, up to the longest; there is no last one. */
export function* waits(longest = 10_000): Generator<number, never> {
  for (let wait = FIRST; ; wait = Math.min(2 * wait, longest)) yield wait;
}

export function pause(length: number): Promise<void> {
  return new Promise((resolve) => setTimeout(resolve, length));
}

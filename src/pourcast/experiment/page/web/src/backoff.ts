/** How long to wait: before something is tried again, and for what may never answer. */

const FIRST = 500;

/** Waits [ms], each twice as long as the one before, up to the longest; there is no last one. */
export function* waits(longest = 10_000): Generator<number, never> {
  for (let wait = FIRST; ; wait = Math.min(2 * wait, longest)) yield wait;
}

export function pause(length: number): Promise<void> {
  return new Promise((resolve) => setTimeout(resolve, length));
}

/** Something did not answer in the time that it was given. */
export class TooLate extends Error {}

/** What a promise comes to, if it does so in time [ms]; what it comes to later is nobody's business. */
export function within<T>(promise: PromiseLike<T>, limit: number): Promise<T> {
  return new Promise((resolve, reject) => {
    const timer = setTimeout(() => reject(new TooLate(`no answer in ${limit / 1000} s`)), limit);
    promise.then(
      (value) => {
        clearTimeout(timer);
        resolve(value);
      },
      (reason: unknown) => {
        clearTimeout(timer);
        // jatos.js rejects with a text.
        reject(reason instanceof Error ? reason : new Error(String(reason)));
      },
    );
  });
}

/** What is drawn at random. */

/** Numbers of 32 bits. Without the browser's own source, a weaker one: nothing secret hangs on them. */
export function drawn(count: number): number[] {
  const numbers = new Uint32Array(count);
  try {
    crypto.getRandomValues(numbers);
  } catch {
    for (let k = 0; k < count; k++) numbers[k] = Math.floor(Math.random() * 2 ** 32);
  }
  return [...numbers];
}

/** A word that nobody else draws. */
export function makeWord(): string {
  return drawn(4)
    .map((number) => number.toString(16).padStart(8, "0"))
    .join("");
}

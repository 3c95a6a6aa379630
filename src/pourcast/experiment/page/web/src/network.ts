/** Requests: a fault of the network or of the server, which passes, is told from all others. */
import { TooLate, within } from "./backoff";

/** Nobody is reached, nobody answers, or who answers has a problem: asking again may help. */
export class Unreachable extends Error {
  constructor(
    readonly why: "offline" | "silent" | "failing",
    detail: string,
  ) {
    super(detail);
  }
}

/** Whether an answer of this status may be another one a moment later. */
export function isPassing(status: number): boolean {
  return status >= 500 || status === 408 || status === 429;
}

export interface Answer<T> {
  status: number;
  ok: boolean;
  content: T;
}

/** An answer in JSON; `undefined` where a refusal has none. */
export async function askForJson(url: string, init: RequestInit, limit: number): Promise<Answer<unknown>> {
  return ask(url, init, limit, async (answer) => {
    if (answer.ok) return (await answer.json()) as unknown;
    return (await answer.json().catch(() => undefined)) as unknown;
  });
}

/** A file. */
export async function askForFile(url: string, limit: number): Promise<Answer<Blob>> {
  return ask(url, {}, limit, (answer) => answer.blob());
}

/**
 * Asks, and reads the answer, in the time that is given [ms].
 *
 * `AbortSignal.timeout` would do, but not every browser that is served has it; and with a fetch
 * that does not hear of its end, as seen in service workers, it would wait for ever.
 */
async function ask<T>(
  url: string,
  init: RequestInit,
  limit: number,
  read: (answer: Response) => Promise<T>,
): Promise<Answer<T>> {
  const controller = new AbortController();
  const asked = async () => {
    const answer = await fetch(url, { ...init, signal: controller.signal });
    return { status: answer.status, ok: answer.ok, content: await read(answer) };
  };
  try {
    return await within(asked(), limit);
  } catch (error) {
    throw unreachable(error) ?? error;
  } finally {
    controller.abort();
  }
}

/** What the network's own errors come to; none for errors of other kinds. */
function unreachable(error: unknown): Unreachable | undefined {
  if (error instanceof TooLate) return new Unreachable("silent", error.message);
  // What should be JSON and isn't comes from somebody between: the login page of a hotel's network.
  if (error instanceof SyntaxError) return new Unreachable("failing", "the answer is not the server's");
  // That nobody was reached, or the answer stopped halfway: a TypeError for fetch, a DOMException for the body.
  const isNetwork = error instanceof TypeError || error instanceof DOMException;
  return isNetwork ? new Unreachable("offline", error.message) : undefined;
}

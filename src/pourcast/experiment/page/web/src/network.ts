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
export function askForJson(url: string, init: RequestInit, limit: number): Promise<Answer<unknown>> {
  return ask(url, init, limit, (answer) => {
    const read = answer.json() as Promise<unknown>;
    return answer.ok ? read : read.catch(() => undefined);
  });
}

/** A file. */
export function askForFile(url: string, limit: number): Promise<Answer<Blob>> {
  return ask(url, {}, limit, (answer) => answer.blob());
}

/**
 * Asks, and reads the answer, in the time that is given [ms].
 *
 * `AbortSignal.timeout` would do, but not every browser that is served has it; and where a fetch
 * does not hear that it is over, it would wait for ever.
 */
async function ask<T>(
  url: string,
  init: RequestInit,
  limit: number,
  read: (answer: Response) => Promise<T>,
): Promise<Answer<T>> {
  const controller = new AbortController();
  const asked = async () => {
    const answer = await carried(fetch(url, { ...init, signal: controller.signal }));
    return { status: answer.status, ok: answer.ok, content: await carried(read(answer)) };
  };
  try {
    return await within(asked(), limit);
  } catch (error) {
    if (error instanceof TooLate) throw new Unreachable("silent", error.message);
    throw error;
  } finally {
    controller.abort();
  }
}

/**
 * What the network brings, or its own errors as `Unreachable`. They are in the promise; what the
 * browser lacks, and what we do wrong, is thrown before there is one.
 */
async function carried<T>(promise: Promise<T>): Promise<T> {
  try {
    return await promise;
  } catch (error) {
    // What should be JSON and isn't comes from somebody between: the login page of a hotel's network.
    if (error instanceof SyntaxError) throw new Unreachable("failing", "the answer is not the server's");
    // Nobody was reached, or the answer stopped halfway.
    if (error instanceof TypeError || error instanceof DOMException)
      throw new Unreachable("offline", error.message);
    throw error;
  }
}

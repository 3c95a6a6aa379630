/**
 * What the browser remembers over a reload, in its local storage. Where that is denied or full, the
 * tab's entry in the history remembers it: every browser keeps that, until the tab is closed.
 */

const NAME = "pourcast";

/** What was remembered under a name; nothing, if it can't be read. */
export function recall(key: string): unknown {
  const text = inHistory()[key] ?? inStorage(key);
  try {
    return text === null ? undefined : (JSON.parse(text) as unknown);
  } catch {
    return undefined;
  }
}

export function remember(key: string, content: object): void {
  const text = JSON.stringify(content);
  try {
    localStorage.setItem(key, text);
    forgetInHistory(key);
  } catch {
    writeHistory({ ...inHistory(), [key]: text });
  }
}

export function forget(key: string): void {
  forgetInHistory(key);
  try {
    localStorage.removeItem(key);
  } catch {
    // There is nothing to be removed.
  }
}

function inStorage(key: string): string | null {
  try {
    return localStorage.getItem(key);
  } catch {
    return null;
  }
}

function inHistory(): { [key: string]: string } {
  const state = history.state as { [NAME]?: { [key: string]: string } } | null;
  return state?.[NAME] ?? {};
}

function forgetInHistory(key: string): void {
  const { [key]: there, ...others } = inHistory();
  if (there !== undefined) writeHistory(others);
}

function writeHistory(content: { [key: string]: string }): void {
  try {
    history.replaceState({ ...(history.state as object | null), [NAME]: content }, "");
  } catch {
    // Some browsers count these, and refuse after many: then a reload begins anew.
  }
}

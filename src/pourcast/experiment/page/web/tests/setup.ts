/** Before each test: a browser that has kept nothing yet. */
import "fake-indexeddb/auto";

import { IDBFactory } from "fake-indexeddb";
import { afterEach, beforeEach, vi } from "vitest";

beforeEach(() => {
  globalThis.indexedDB = new IDBFactory();
  localStorage.clear();
  history.replaceState(null, "");
  document.body.replaceChildren();
});

afterEach(() => {
  vi.useRealTimers();
});

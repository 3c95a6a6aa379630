/** A key that is held down presses one button. */
import { beforeEach, describe, expect, it } from "vitest";

import { pressOnce } from "../src/keys";

function prevented(on: string, init: KeyboardEventInit): boolean {
  const element = document.createElement(on);
  document.body.append(element);
  const event = new KeyboardEvent("keydown", { bubbles: true, cancelable: true, ...init });
  element.dispatchEvent(event);
  return event.defaultPrevented;
}

beforeEach(() => {
  document.addEventListener("keydown", pressOnce, true);
  return () => document.removeEventListener("keydown", pressOnce, true);
});

describe("ENTER", () => {
  it("that is held down presses no button, and hands nothing in", () => {
    expect(prevented("button", { key: "Enter", repeat: true })).toBe(true);
    expect(prevented("input", { key: "Enter", repeat: true })).toBe(true);
  });

  it("that is pressed once does", () => {
    expect(prevented("button", { key: "Enter" })).toBe(false);
  });

  it("writes as many lines as one likes", () => {
    expect(prevented("textarea", { key: "Enter", repeat: true })).toBe(false);
  });

  it("is the only such key", () => {
    expect(prevented("button", { key: "ArrowLeft", repeat: true })).toBe(false);
  });
});

/** Forms: what was chosen or written is what is recorded. */
import type { JsPsych } from "jspsych";
import { describe, expect, it } from "vitest";

import FormPlugin from "../src/plugins/form";

type Trial = Parameters<FormPlugin["trial"]>[1];
type Data = { [key: string]: unknown };

const QUESTIONS = [
  { question: "What <is> asked?", choices: ["this", "that & more"], right: 1 },
  { question: "And then?", choices: ["a", "b", "c"], right: 2 },
];

function shown(changed: Partial<Trial> = {}): { display: HTMLElement; plugin: FormPlugin; trial: Trial; data: Data[] } {
  const display = document.createElement("div");
  document.body.replaceChildren(display);
  const data: Data[] = [];
  const jsPsych = { finishTrial: (found: Data) => data.push(found) };
  const plugin = new FormPlugin(jsPsych as unknown as JsPsych);
  const trial: Trial = {
    type: FormPlugin,
    title: "A title",
    body: "One.\n\nTwo.",
    questions: [],
    label: "Remarks",
    button: "Go on",
    ...changed,
  };
  plugin.trial(display, trial);
  return { display, plugin, trial, data };
}

function submit(display: HTMLElement): Event {
  const event = new Event("submit", { cancelable: true });
  display.querySelector("form")?.dispatchEvent(event);
  return event;
}

describe("a form", () => {
  it("records the number of each choice, and stays on the page", () => {
    const { display, data } = shown({ questions: QUESTIONS });
    const radios = display.querySelectorAll("input");
    expect(radios).toHaveLength(5);
    for (const k of [1, 4]) (radios[k] as HTMLInputElement).checked = true;
    expect(submit(display).defaultPrevented).toBe(true);
    expect(data).toHaveLength(1);
    expect(data[0]).toMatchObject({ choices: [1, 2], text: "" });
  });

  it("asks for an answer to every question, one a question", () => {
    const { display } = shown({ questions: QUESTIONS });
    const radios = [...display.querySelectorAll("input")];
    expect(radios.every((radio) => radio.required)).toBe(true);
    expect(radios.map((radio) => radio.name)).toEqual(["q0", "q0", "q1", "q1", "q1"]);
    expect(document.activeElement).toBe(radios[0]);
  });

  it("says -1 of a question without an answer", () => {
    const { display, data } = shown({ questions: QUESTIONS });
    (display.querySelectorAll("input")[0] as HTMLInputElement).checked = true;
    submit(display);
    expect(data[0]).toMatchObject({ choices: [0, -1] });
  });

  it("has a field for text where it asks nothing, and records it as it was written", () => {
    const { display, data } = shown();
    const field = display.querySelector("textarea") as HTMLTextAreaElement;
    expect(document.activeElement).toBe(field);
    expect(field.maxLength).toBe(5000);
    field.value = 'It was <b>fine</b>, "really"\n';
    submit(display);
    expect(data[0]).toMatchObject({ choices: [], text: 'It was <b>fine</b>, "really"\n' });
  });

  it("shows words as they stand, never as HTML", () => {
    const evil = "<i>x</i>";
    const questions = [{ question: evil, choices: [evil], right: 0 }];
    const { display } = shown({ title: evil, body: evil, button: evil, questions });
    expect(display.querySelector("i")).toBeNull();
    expect(display.querySelector("legend")?.textContent).toBe(evil);
    expect(shown({ label: evil }).display.querySelector("i")).toBeNull();
  });

  it("records what it declares, simulated or not", () => {
    const { plugin, trial, display, data } = shown({ questions: QUESTIONS });
    submit(display);
    plugin.simulate(trial, "data-only", {}, () => undefined);
    expect(data[1]).toMatchObject({ choices: [1, 2] });
    for (const one of data)
      expect(Object.keys(one).toSorted()).toEqual(Object.keys(FormPlugin.info.data).toSorted());
  });
});

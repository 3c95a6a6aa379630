/** Questions on one page: choices, or a text; answered with mouse or keyboard. */
import { ParameterType, type JsPsych, type JsPsychPlugin, type TrialType } from "jspsych";

import type { Question } from "../texts";
import { WATCHED, Watch } from "../watch";
import { escaped, paragraphs } from "../words";

const info = {
  name: "pourcast-form",
  version: "1.0.0",
  parameters: {
    title: { type: ParameterType.STRING, default: "" },
    body: { type: ParameterType.STRING, default: "" },
    /** Questions with `question` and `choices`; without questions there is a field for text. */
    questions: { type: ParameterType.COMPLEX, array: true, default: [] },
    /** Label of the field for text. */
    label: { type: ParameterType.STRING, default: "" },
    button: { type: ParameterType.STRING, default: "Continue" },
  },
  data: {
    /** Numbers of the choices, from 0; -1 without an answer. */
    choices: { type: ParameterType.INT, array: true },
    /** What was written. */
    text: { type: ParameterType.STRING },
    /** Time until the form was handed in [s]. */
    rt: { type: ParameterType.FLOAT },
    ...WATCHED,
  },
} as const;

type Info = typeof info;

const LONGEST_TEXT = 5000;

export default class FormPlugin implements JsPsychPlugin<Info> {
  static info = info;

  constructor(private jsPsych: JsPsych) {}

  trial(display: HTMLElement, trial: TrialType<Info>): void {
    const questions = trial.questions as Question[];
    const asked = questions.map(
      (one, k) => `
        <fieldset><legend>${escaped(one.question)}</legend>${one.choices
          .map(
            (choice, j) =>
              `<label><input type="radio" name="q${k}" value="${j}" required> ${escaped(choice)}</label>`,
          )
          .join("")}</fieldset>`,
    );
    const field = `<label>${escaped(trial.label as string)}<textarea rows="5" maxlength="${LONGEST_TEXT}"></textarea></label>`;
    display.innerHTML = `
      <div class="text"><h1>${escaped(trial.title as string)}</h1>${paragraphs(trial.body as string)}
        <form>${questions.length ? asked.join("") : field}
          <button class="jspsych-btn" type="submit">${escaped(trial.button as string)}</button>
        </form></div>`;
    const form = display.querySelector("form") as HTMLFormElement;
    const watch = new Watch();
    const began = performance.now();
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      const chosen = new FormData(form);
      this.jsPsych.finishTrial({
        choices: questions.map((_, k) => Number(chosen.get(`q${k}`) ?? -1)),
        text: form.querySelector("textarea")?.value ?? "",
        rt: Math.round(performance.now() - began) / 1000,
        ...watch.stop(),
      });
    });
    (form.querySelector("input, textarea") as HTMLElement).focus();
  }

  simulate(
    trial: TrialType<Info>,
    _mode: string,
    options: { data?: { text?: string } },
    onLoad: () => void,
  ): void {
    onLoad();
    this.jsPsych.finishTrial({
      choices: (trial.questions as Question[]).map((one) => one.right),
      text: options.data?.text ?? "",
      rt: 1,
      ...new Watch().stop(),
    });
  }
}

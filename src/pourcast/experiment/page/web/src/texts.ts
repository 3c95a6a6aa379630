/** All that participants read; `experiment/design/texts/en.toml` has it in English. */
interface Titled {
  title: string;
  body: string;
}

interface Buttoned extends Titled {
  button: string;
}

/** A question about the instructions, and the number of the right choice. */
export interface Question {
  question: string;
  choices: string[];
  right: number;
}

/** What the goal asks. */
interface GoalTexts {
  instructions: string[];
  quiz: Question[];
  question: string;
  slider: string;
  low: string;
  high: string;
  value: string;
}

export interface Texts {
  page: { title: string; continue: string; back: string; loading: string; loading_slow: string; loading_missing: string; saving: string };
  consent: Titled & { contact: string; agree: string; agree_button: string; decline_button: string };
  check: Titled & { too_small: string; again: string; leave: string };
  fullscreen: Buttoned & { left: string; refused: string; without: string };
  instructions: { title: string; end: { answer: string; practice: string; test: string; test_alone: string } };
  quiz: Buttoned & { wrong: string; again: string };
  goal: GoalTexts;
  /** Liquids that are shown, by what they are called. */
  liquids: { [liquid: string]: { name: string; description: string } };
  trial: {
    practice: string;
    test: string;
    picture: string;
    unset: string;
    set: string;
    button: string;
  };
  film: { title: string; picture: string; unplayable: string; blocked: string; play: string };
  practice_end: Buttoned;
  break: Buttoned;
  debrief: Buttoned & { label: string };
  end: Titled & {
    code: string;
    redirect: string;
    close: string;
    offline: string;
    silent: string;
    failing: string;
    refused: string;
    broken: string;
    kept: string;
    kept_in_page: string;
    meanwhile: string;
    file: string;
    offline_code: string;
    download: string;
  };
  /** Why a service that collects answers does not take them. */
  collecting: {
    inactive: string;
    unknown: string;
    limit: string;
    invalid: string;
    storage: string;
    large: string;
    other: string;
  };
  resume: Buttoned & { anew: string };
  tabs: Buttoned & { moved: string };
  /** Why a session can't begin or go on, by the reason. */
  stop: { [reason: string]: string };
}

"""Who sees what, and when: the steps of one session."""

import hashlib
import hmac
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from pourcast.errors import InputError
from pourcast.experiment.design.settings import (
    NAME,
    Design,
    default_design,
    parse_design,
    read_design,
    study_goal,
)
from pourcast.progress import Report, no_report
from pourcast.scenes.liquids.registry import resolve_liquid
from pourcast.scenes.scene import Scene
from pourcast.stimuli.make import QUICK, make_stimuli
from pourcast.stimuli.manifest import FOLDER, StimulusRequest, StimulusSet, best_set, sets_of
from pourcast.study.folder import load_practice, study_experiment, study_liquids, study_scenes
from pourcast.study.responses import TEST

PRACTICE = "practice"
"""The phase with films; no model is compared on it."""

Kind = Literal["consent", "check", "instructions", "judgment", "film", "break", "debrief"]
"""What is to be done in a step."""

_ORDER = 2


class Step(BaseModel):
    """One thing that a participant does, and is kept one record of.

    Parameters
    ----------
    seq
        Number of the step in its session; with the session's the key of the record.
    kind
        What is to be done.
    phase, trial
        Of judgments and films: `practice` or `test`, and the number in it from 1.
    block
        Of test trials and breaks, from 1.
    liquid, scene, mirrored
        What is judged. Participants' browsers are not told the scene's id.
    still, film
        Names under which the server hands them out.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    seq: int
    kind: Kind
    phase: str = ""
    trial: int = 0
    block: int = 0
    liquid: str = ""
    scene: str = ""
    mirrored: bool = False
    still: str = ""
    film: str = ""

    def for_participant(self) -> dict[str, Any]:
        """The step as the browser gets it."""
        return self.model_dump(exclude={"scene", "mirrored"}, exclude_defaults=True) | {
            "seq": self.seq
        }


@dataclass(frozen=True)
class Shown:
    """A trial's scene and liquid, mirrored or not."""

    scene: Scene
    liquid: str
    mirrored: bool = False
    film: bool = False

    @property
    def key(self) -> tuple[str, str, bool]:
        """What tells it from all others of a study."""
        return self.scene.id, self.liquid, self.mirrored

    @property
    def seen(self) -> Scene:
        """The scene as it is shown."""
        return self.scene.mirrored() if self.mirrored else self.scene


def practice_trials(practice: Sequence[Scene], design: Design, group: int) -> list[Shown]:
    """Practice trials of a group; the liquids take turns."""
    liquids = design.groups[group]
    return [
        Shown(scene, liquids[k % len(liquids)], film=True)
        for k, scene in enumerate(practice[: design.practice])
    ]


def test_trials(scenes: Sequence[Scene], design: Design, group: int, place: int) -> list[Shown]:
    """Test trials of a group's place, in their order."""
    trials = [
        Shown(scene, liquid, liquid in design.mirrored)
        for liquid in design.groups[group]
        for scene in scenes
    ]
    # Groups that see one liquid each share the order of the scenes, as in the paper.
    entropy = [design.seed, _ORDER, *([place] if design.order == "own" else [])]
    return [trials[k] for k in np.random.default_rng(entropy).permutation(len(trials))]


def own_default(study: Path) -> str:
    """The paper's design for a study's scenes, as the content of `experiment.toml`.

    Raises
    ------
    InputError
        If its scenes ask different things.
    """
    study_goal(study)
    experiment = study_experiment(study, study_scenes(study))
    return default_design(experiment, len(load_practice(study)))


def all_shown(study: Path) -> list[Shown]:
    """All that a study's participants are shown, by its design or, without one, the paper's."""
    if (study / NAME).is_file():
        design = read_design(study)
    else:
        design = parse_design(study, tomllib.loads(own_default(study)))
    return Stock(study, study_scenes(study), load_practice(study), design, b"").wanted()


class Stock:
    """Scenes, stimuli and the names under which participants get them.

    Parameters
    ----------
    study
        The study folder.
    scenes, practice
        Scenes to be judged, and to practise with.
    design
        The design.
    secret
        Key of the names, so that they give nothing away.
    """

    def __init__(
        self,
        study: Path,
        scenes: Sequence[Scene],
        practice: Sequence[Scene],
        design: Design,
        secret: bytes,
    ) -> None:
        if len(practice) < design.practice:
            raise InputError(
                f"{study / 'practice.json'}: expected {design.practice} scenes, as the design's "
                f"practice says, found {len(practice)}"
            )
        self.study, self.scenes, self.practice = study, scenes, practice
        self.design, self._secret = design, secret
        self._stimuli: StimulusSet | None = None
        self.files: dict[str, Path] = {}
        """Names handed out, and the files they stand for."""
        self._names: dict[tuple[str, str, bool], tuple[str, str]] = {}

    @property
    def stimuli(self) -> StimulusSet:
        """What is shown, once it is prepared: the set nearest to the paper's that has all of it."""
        assert self._stimuli is not None
        return self._stimuli

    @property
    def digest(self) -> str:
        """Name of what is asked: scenes and design."""
        content = [scene.digest for scene in (*self.scenes, *self.practice)]
        content.append(self.design.model_dump_json())
        return hashlib.sha256("\n".join(content).encode()).hexdigest()

    def wanted(self) -> list[Shown]:
        """All that anybody is shown, films first."""
        groups = range(len(self.design.groups))
        return [
            *(one for g in groups for one in practice_trials(self.practice, self.design, g)),
            *(one for g in groups for one in test_trials(self.scenes, self.design, g, 0)),
        ]

    def prepare(self, report: Report | None = None) -> None:
        """Choose the stimuli; if no set has all that is wanted, make quick ones."""
        shown = self.wanted()
        requests = [self._request(one) for one in shown]
        stimuli = best_set(self.study, requests)
        if stimuli is None:
            stimuli = make_stimuli(self.study, requests, QUICK, report=report or no_report)
        self._stimuli = stimuli
        for one in shown:
            self._names[one.key] = self._handed_out(one, stimuli)

    def _request(self, shown: Shown) -> StimulusRequest:
        """The stimulus that shows a trial."""
        liquid = resolve_liquid(shown.liquid, shown.scene, study_liquids(self.study))
        return StimulusRequest(shown.seen, liquid, shown.film)

    def _handed_out(self, shown: Shown, stimuli: StimulusSet) -> tuple[str, str]:
        """Names of still and film (empty without one)."""
        request = self._request(shown)
        stimulus = stimuli.find(request.scene, request.liquid)
        if stimulus is None:
            raise InputError(
                f"{self.study / FOLDER}: no stimulus of scene {shown.scene.id} ({shown.liquid}"
                f"{', mirrored' if shown.mirrored else ''})"
            )
        still = self._hand_out(stimuli.folder / stimulus.still)
        # The films of test trials, should there be any, stay in the folder.
        film = (
            self._hand_out(stimuli.folder / stimulus.film) if shown.film and stimulus.film else ""
        )
        return still, film

    def hand_out_of(self, plans: Iterable[Sequence[Step]]) -> None:
        """Hand out what sessions were promised before design or stimuli were changed."""
        promised = {name for plan in plans for step in plan for name in (step.still, step.film)}
        for stimuli in sets_of(self.study):
            for stimulus in stimuli.manifest.stimuli:
                for file in (stimuli.folder / name for name in stimulus.files):
                    if self._name(file) in promised:
                        self._hand_out(file)

    def _name(self, file: Path) -> str:
        place = f"{file.parent.name}/{file.name}"
        digest = hmac.new(self._secret, place.encode(), hashlib.sha256).hexdigest()
        return digest[:32] + file.suffix

    def _hand_out(self, file: Path) -> str:
        name = self._name(file)
        self.files[name] = file
        return name

    def plan(self, group: int, place: int) -> list[Step]:
        """All steps of a session."""
        design = self.design
        steps: list[dict[str, Any]] = [{"kind": kind} for kind in ("consent", "check")]
        steps.append({"kind": "instructions"})
        for number, one in enumerate(practice_trials(self.practice, design, group), start=1):
            trial = self._trial(one) | {"phase": PRACTICE, "trial": number}
            steps += [trial | {"kind": "judgment"}, trial | {"kind": "film"}]
        trials = test_trials(self.scenes, design, group, place)
        ends = np.linspace(0, len(trials), min(design.blocks, len(trials)) + 1).round()[1:-1]
        block = 1
        for number, one in enumerate(trials, start=1):
            trial = self._trial(one) | {"phase": TEST, "trial": number, "block": block}
            steps.append(trial | {"kind": "judgment", "film": ""})
            if number in ends:
                steps.append({"kind": "break", "block": block})
                block += 1
        steps.append({"kind": "debrief"})
        return [Step(seq=seq, **step) for seq, step in enumerate(steps)]

    def _trial(self, shown: Shown) -> dict[str, Any]:
        still, film = self._names[shown.key]
        return {
            "liquid": shown.liquid,
            "scene": shown.scene.id,
            "mirrored": shown.mirrored,
            "still": still,
            "film": film,
        }

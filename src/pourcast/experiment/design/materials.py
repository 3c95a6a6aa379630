"""The materials of an experiment: scenes, stimuli, and the names that browsers get them under."""

import hashlib
import hmac
import tomllib
from collections.abc import Iterable, Sequence
from pathlib import Path

from pourcast.errors import InputError
from pourcast.experiment.design.schedule import (
    Trial,
    all_trials,
    practice_trials,
    session_steps,
    test_trials,
)
from pourcast.experiment.design.settings import (
    NAME,
    Design,
    default_design,
    parse_design,
    read_design,
    study_goal,
)
from pourcast.experiment.design.steps import Step
from pourcast.files import write_text
from pourcast.progress import Report, no_report
from pourcast.scenes.liquids.registry import resolve_liquid
from pourcast.scenes.scene import Scene
from pourcast.stimuli.make import QUICK, make_stimuli
from pourcast.stimuli.manifest import FOLDER, StimulusRequest, StimulusSet, best_set, sets_of
from pourcast.study.folder import load_practice, study_experiment, study_liquids, study_scenes


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


def prepare_design(study: Path) -> Design:
    """A study's design; the paper's is written for a study that has none."""
    if not (study / NAME).is_file():
        write_text(study / NAME, own_default(study))
    return read_design(study)


def study_trials(study: Path) -> list[Trial]:
    """All trials of a study's participants, by its design or, without one, the paper's."""
    if (study / NAME).is_file():
        design = read_design(study)
    else:
        design = parse_design(study, tomllib.loads(own_default(study)))
    practice = load_practice(study)
    _check_practice(study, practice, design)
    return all_trials(study_scenes(study), practice, design)


def prepare_materials(study: Path, secret: bytes, report: Report = no_report) -> "Materials":
    """A study's materials, as its design asks for them; stimuli that are missing are made.

    Parameters
    ----------
    study
        The study folder. The paper's design is written into it if it has none.
    secret
        Key of the names that browsers get files under.
    report
        Told of the progress of making stimuli.

    Raises
    ------
    InputError
        If the study is not fit for an experiment.
    """
    materials = Materials(
        study, study_scenes(study), load_practice(study), prepare_design(study), secret
    )
    materials.prepare(report)
    return materials


class Materials:
    """Scenes, stimuli and the names under which participants' browsers get them.

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

    Raises
    ------
    InputError
        If there are fewer scenes to practise with than the design asks for.
    """

    def __init__(
        self,
        study: Path,
        scenes: Sequence[Scene],
        practice: Sequence[Scene],
        design: Design,
        secret: bytes,
    ) -> None:
        _check_practice(study, practice, design)
        self.study, self.scenes, self.practice = study, scenes, practice
        self.design, self._secret = design, secret
        self._own = study_liquids(study)
        self._stimuli: StimulusSet | None = None
        self.published: dict[str, Path] = {}
        """Names that browsers may ask for, and the files they stand for."""
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

    def prepare(self, report: Report = no_report) -> None:
        """Choose the stimuli; if no set has all that is needed, make quick ones."""
        trials = all_trials(self.scenes, self.practice, self.design)
        requests = [self._request(trial) for trial in trials]
        stimuli = best_set(self.study, requests)
        if stimuli is None:
            stimuli = make_stimuli(self.study, requests, QUICK, report=report)
        self._stimuli = stimuli
        for trial in trials:
            self._names[trial.key] = self._publish_trial(trial, stimuli)

    def steps(self, group: int, place: int) -> list[Step]:
        """All steps of the session of a group's place; a `Schedule`."""
        return session_steps(
            practice_trials(self.practice, self.design, group),
            test_trials(self.scenes, self.design, group, place),
            self.design.blocks,
            lambda trial: self._names[trial.key],
        )

    def publish_for(self, sessions: Iterable[Sequence[Step]]) -> None:
        """Publish what sessions began with before design or stimuli were changed."""
        promised = {
            name for steps in sessions for step in steps for name in (step.still, step.film)
        }
        for stimuli in sets_of(self.study):
            for stimulus in stimuli.manifest.stimuli:
                for file in (stimuli.folder / name for name in stimulus.files):
                    if self._secret_name(file) in promised:
                        self._publish(file)

    def _request(self, trial: Trial) -> StimulusRequest:
        """The stimulus that shows a trial."""
        liquid = resolve_liquid(trial.liquid, trial.scene, self._own)
        return StimulusRequest(trial.shown_scene, liquid, trial.film)

    def _publish_trial(self, trial: Trial, stimuli: StimulusSet) -> tuple[str, str]:
        """Publish a trial's still, and its film if it has one; returns their names."""
        request = self._request(trial)
        stimulus = stimuli.find(request.scene, request.liquid)
        if stimulus is None:
            raise InputError(
                f"{self.study / FOLDER}: no stimulus of scene {trial.scene.id} ({trial.liquid}"
                f"{', mirrored' if trial.mirrored else ''})"
            )
        still = self._publish(stimuli.folder / stimulus.still)
        # The films of test trials, should there be any, stay in the folder.
        if not (trial.film and stimulus.film):
            return still, ""
        return still, self._publish(stimuli.folder / stimulus.film)

    def _publish(self, file: Path) -> str:
        name = self._secret_name(file)
        self.published[name] = file
        return name

    def _secret_name(self, file: Path) -> str:
        path = f"{file.parent.name}/{file.name}"
        digest = hmac.new(self._secret, path.encode(), hashlib.sha256).hexdigest()
        return digest[:32] + file.suffix


def _check_practice(study: Path, practice: Sequence[Scene], design: Design) -> None:
    """Refuse a design that asks for more scenes to practise with than there are."""
    if len(practice) < design.practice:
        raise InputError(
            f"{study / 'practice.json'}: expected {design.practice} scenes, as the design's "
            f"practice says, found {len(practice)}"
        )

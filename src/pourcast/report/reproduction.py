"""An experiment from nothing to a report beside the published values."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pourcast.comparison.agreement import Settings
from pourcast.comparison.candidates import candidates
from pourcast.comparison.choice import count_without_alphas, read_choice
from pourcast.comparison.compare import Comparison, compare_study
from pourcast.comparison.matching import ComparisonOptions
from pourcast.errors import InputError, StoreError
from pourcast.experiment.data.responses import study_responses
from pourcast.models.registry import complete_presets
from pourcast.networks.training.pair import DEFAULT_SCENES as CONVNET_SCENES
from pourcast.networks.training.pair import (
    QUICK,
    NetworkRequest,
    default_recipe,
    network_spec,
    train_networks,
)
from pourcast.observers.responses import observers_of, rehearse
from pourcast.progress import Report, no_report
from pourcast.report.page import Options, write_report
from pourcast.scenes.scene import Scene
from pourcast.study.experiments.registry import EXPERIMENTS
from pourcast.study.folder import SceneRequest, open_study
from pourcast.study.responses import exclude
from pourcast.study.scale import Scale
from pourcast.study.trials import Trials, arrange
from pourcast.sweep.grid import Grid, experiment_grid, parse_grid, read_grid
from pourcast.sweep.judgments import study_judgments, sweep_in_study, sweep_words
from pourcast.sweep.table import write_judgments

QUICK_SCENES = 24
QUICK_CONVNET_SCENES = 500
QUICK_GRID = "quick"


ALPHA_GRID = """\
# Thicker water at the number of particles that the responses chose: the next stage of the fit.
title = "viscosity at N = {count}"

[[models]]
model = "ife"
liquids = {liquids}
parameters.liquid = "water"
parameters.n_particles = {count}
parameters.viscosity_alpha = [0.2, 2]
parameters.damping_zeta = {{ from = 0, to = 16, step = 1 }}
parameters.zeta_sigma = 4
"""
"""The paper's other values of alpha, which its grid has at N = 50 only."""


@dataclass(frozen=True)
class Reproduction:
    """What is to be reproduced.

    Parameters
    ----------
    experiment
        Name of the experiment.
    quick
        24 scenes and a small grid, a first look.
    seed
        Source of all randomness.
    scenes
        Number of scenes, if not the paper's (or 24).
    responses
        People's responses; simulated observers answer without.
    carry_from
        An Experiment 1 that was reproduced before: its parameters are carried over.
    exclude, scale, columns
        As for `comparison.compare.ComparisonOptions`.
    with_convnet
        Whether to train networks, and compare them, too.
    convnet_scenes
        Their training scenes, if not the paper's (or 500).
    """

    experiment: str
    quick: bool = False
    seed: int = 1
    scenes: int | None = None
    responses: Path | None = None
    carry_from: Path | None = None
    exclude: tuple[str, ...] = ()
    scale: Scale | None = None
    columns: str | None = None
    with_convnet: bool = False
    convnet_scenes: int | None = None

    def __post_init__(self) -> None:
        if self.columns is not None and self.responses is None:
            raise InputError("columns: goes with --responses")

    @property
    def networks(self) -> NetworkRequest:
        """The networks, for `with_convnet`."""
        recipe = default_recipe(**(QUICK if self.quick else {}))
        count = self.convnet_scenes or (QUICK_CONVNET_SCENES if self.quick else CONVNET_SCENES)
        return NetworkRequest(self.experiment, count, recipe=recipe, seed=self.seed)

    @property
    def request(self) -> SceneRequest:
        """The scenes."""
        count = self.scenes or (QUICK_SCENES if self.quick else None)
        return SceneRequest(self.experiment, count, self.seed, quick=self.quick)


def reproduce(
    folder: Path, wanted: Reproduction, workers: int | None = None, report: Report = no_report
) -> tuple[Comparison, Path]:
    """Scenes, simulations, observers, comparison, report; goes on where it was stopped.

    Parameters
    ----------
    folder
        The study folder to make.
    wanted
        What is to be reproduced.
    workers
        Processes; all cores by default.
    report
        Told of the progress.

    Returns
    -------
    Comparison, Path
        What came out, and the report's page.
    """
    carried = None if wanted.carry_from is None else read_choice(wanted.carry_from)
    scenes = open_study(folder, wanted.request, report)
    if wanted.responses is not None:
        _trials(folder, wanted, wanted.responses, scenes)  # Bad input is told before long work.
    networks = _networks(folder, wanted, workers, report)
    experiment = EXPERIMENTS.get(wanted.experiment)
    grid = read_grid(QUICK_GRID) if wanted.quick else experiment_grid(experiment)
    _sweep(folder, scenes, grid, workers, report)
    responses = wanted.responses
    if responses is None:
        observers = observers_of(experiment, seed=wanted.seed)
        responses = rehearse(folder, scenes, observers, report=report)
    request = ComparisonOptions(
        responses=responses, models=(*(experiment.models or complete_presets()), *networks),
        scale=wanted.scale, columns=wanted.columns, exclude=wanted.exclude,
        settings=Settings(seed=wanted.seed), carried=carried,
    )  # fmt: skip
    trials = _trials(folder, wanted, responses, scenes)
    count = count_without_alphas(candidates(study_judgments(folder, scenes), trials))
    if count is not None:
        liquids = json.dumps(experiment.shown_liquids)
        text = ALPHA_GRID.format(count=count, liquids=liquids)
        _sweep(folder, scenes, parse_grid(text, f"alpha-{count}", "alpha"), workers, report)
    comparison = compare_study(folder, request, report)
    page = write_report(comparison, folder / "report", Options(), report)
    return comparison, page


def _networks(folder: Path, wanted: Reproduction, workers: int | None, report: Report) -> list[str]:
    """Specs of the networks, which are trained if they are not there yet."""
    if not wanted.with_convnet:
        return []
    made = train_networks(folder / "convnet", wanted.networks, workers=workers, report=report)
    return [network_spec(path.stem, path) for path in made]


def _trials(
    folder: Path, wanted: Reproduction, responses: Path, scenes: Sequence[Scene]
) -> list[Trials]:
    table, source = study_responses(
        folder, responses, scenes, scale=wanted.scale, columns=wanted.columns
    )
    return arrange(exclude(table, wanted.exclude)[0], scenes, str(source))


def _sweep(
    folder: Path, scenes: Sequence[Scene], grid: Grid, workers: int | None, report: Report
) -> None:
    """Run a grid in the study, and write its judgments."""
    tell = sweep_words(report, "simulating")
    result = sweep_in_study(folder, scenes, grid, workers=workers, report=tell)
    write_judgments(folder / "judgments", grid.name, result.table)
    if result.failures:
        raise StoreError(f"{folder}: {result.failures[0].message}")

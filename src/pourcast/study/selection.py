"""Choosing among drawn scenes by simulating them.

`filtered_scenes` drops scenes in which the liquid stays caught or hardly meets
an obstacle (Bates et al., Experiment 1). A `SceneChoice` is what an experiment
says of it: `FilteredScenes`, or `ContrastingScenes` on which two models disagree
(Experiment 2).
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from operator import attrgetter
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pourcast.errors import InputError
from pourcast.models.base import SimulationModel
from pourcast.models.registry import make_model
from pourcast.prediction import JudgmentRequest, judge_together
from pourcast.progress import Report, no_report
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import WATER, resolve_liquid
from pourcast.scenes.scene import Scene
from pourcast.simulation.memory import REMEMBERED, outcomes_of
from pourcast.simulation.pour import Pour
from pourcast.simulation.settings import EngineSettings

BATCH = 64
"""Scenes that are drawn and simulated together."""

_MIN_ACCEPTANCE = 0.002
_PATIENCE = 2000


class SceneFamily(Protocol):
    """A way to draw scenes: a frozen dataclass of its statistics with a method `draw`."""

    @property
    def name(self) -> str:
        """First part of the scenes' ids."""
        ...

    def draw(self, rng: np.random.Generator, scene_id: str) -> Scene | None:
        """Draw a scene, or None if this draw is no good."""
        ...


@dataclass(frozen=True)
class CoarseFilter:
    """Which scenes are kept, by a run of coarse SPH.

    The paper gives no numbers: these limits are inferred (`docs/explanation/open-choices.md`).

    Parameters
    ----------
    n_particles, damping_zeta
        The coarse liquid: the IFE's particles and damping, alpha of water.
    max_stranded
        Largest share of the liquid that may stay on an obstacle.
    min_touched
        Least share of the liquid that must meet an obstacle.
    liquid
        The liquid that is poured, or its name.
    settings
        How pours are computed; by default as models compute them.
    """

    n_particles: int = 50
    damping_zeta: float = 5.0
    max_stranded: float = 0.074
    min_touched: float = 0.71
    liquid: str | Liquid = "water"
    settings: EngineSettings | None = None

    def keeps(self, scenes: Sequence[Scene]) -> list[bool]:
        """Simulate scenes, and say which are kept."""
        pours = [self.pour(scene, resolve_liquid(self.liquid, scene)) for scene in scenes]
        take = attrgetter("stranded", "touched")
        ends = outcomes_of(pours, take, settings=self.settings, memory=REMEMBERED)
        return [
            stranded <= self.max_stranded and touched >= self.min_touched
            for stranded, touched in ends
        ]

    @property
    def words(self) -> str:
        """What it asks, in a line."""
        liquid = self.liquid if isinstance(self.liquid, str) else self.liquid.name
        return (
            f"by a pour of {liquid}, {self.n_particles} particles, damping "
            f"{self.damping_zeta:g}/s: at most {100 * self.max_stranded:g}% of it ends on an "
            f"obstacle, at least {100 * self.min_touched:g}% meets one"
        )

    def pour(self, scene: Scene, liquid: Liquid) -> Pour:
        """The coarse run of a scene."""
        return Pour(scene, liquid, self.n_particles, self.damping_zeta)


CONTRAST_FILTER = CoarseFilter(max_stranded=0.05, min_touched=0.5)
"""Experiment 2's filter: liquid that half misses the three shapes is where honey
and water part."""


@dataclass(frozen=True)
class Selection:
    """Scenes chosen, and how."""

    scenes: list[Scene]
    drawn: int
    """Scenes that were drawn in all."""
    kept: int
    """How many of these passed the filter."""
    left: tuple[int, ...]
    """How many were left by each of the choice's `stages`."""
    figures: Mapping[str, float] = field(default_factory=dict)
    """What the chosen scenes have, by what it is: correlations of what they were chosen by, ..."""


def drawn_scene(family: SceneFamily, seed: int, index: int) -> Scene | None:
    """Scene number `index` of a family's endless list for a seed."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
    return family.draw(rng, f"{family.name}-draw-{index}")


def filtered_scenes(
    family: SceneFamily,
    count: int,
    seed: int,
    *,
    rule: CoarseFilter | None = None,
    report: Report = no_report,
) -> Selection:
    """First `count` scenes of a family that pass the filter.

    Parameters
    ----------
    family
        What is drawn.
    count
        How many scenes are wanted.
    seed
        Source of all randomness.
    rule
        The filter.
    report
        Told of the progress.

    Returns
    -------
    Selection
        The scenes, numbered from 1 in their ids.

    Raises
    ------
    InputError
        If hardly any draw passes.
    """
    rule = rule or CoarseFilter()
    chosen: list[Scene] = []
    drawn = kept = 0
    while len(chosen) < count:
        batch = [drawn_scene(family, seed, drawn + k) for k in range(BATCH)]
        scenes = [scene for scene in batch if scene is not None]
        drawn += BATCH
        passed = [s for s, keep in zip(scenes, rule.keeps(scenes), strict=True) if keep]
        kept += len(passed)
        chosen += passed
        report(f"{kept} of {drawn} draws kept", min(len(chosen), count), count)
        if drawn >= _PATIENCE and kept < _MIN_ACCEPTANCE * drawn:
            raise InputError(f"only {kept} of {drawn} drawn {family.name} scenes pass the filter")
    scenes = numbered(chosen[:count], family.name)
    return Selection(scenes, drawn, kept, left=(drawn, kept, count))


def numbered(scenes: Sequence[Scene], name: str) -> list[Scene]:
    """Scenes whose ids are a name and their number from 1."""
    digits = max(3, len(str(len(scenes))))
    return [
        scene.model_copy(update={"id": f"{name}-{number:0{digits}d}"})
        for number, scene in enumerate(scenes, start=1)
    ]


class SceneChoice(ABC):
    """How an experiment's scenes are chosen: a frozen dataclass with a method `choose`."""

    @property
    @abstractmethod
    def rule(self) -> CoarseFilter:
        """Which draws are considered at all; networks learn from those, too."""

    @property
    def stages(self) -> tuple[tuple[str, str], ...]:
        """How scenes are chosen: what each stage does with them, and by which rule."""
        return (
            ("drawn", "at random"),
            ("filtered", self.rule.words),
            ("chosen", "the first of these"),
        )

    @property
    def judges(self) -> tuple[str, ...]:
        """Models by whose judgments scenes are chosen, beside the filter."""
        return ()

    def pours(self, scene: Scene) -> list[Pour]:
        """All pours of a scene that it is chosen by, the filter's first."""
        own = self.rule.pour(scene, resolve_liquid(self.rule.liquid, scene))
        models = [make_model(spec) for spec in self.judges]
        simulated = [model for model in models if isinstance(model, SimulationModel)]
        return [own, *(pour for model in simulated for pour in model.pours(scene, WATER))]

    @abstractmethod
    def choose(
        self, family: SceneFamily, count: int, seed: int, report: Report = no_report
    ) -> Selection:
        """Choose scenes.

        Parameters
        ----------
        family
            What is drawn.
        count
            How many scenes are wanted.
        seed
            Source of all randomness.
        report
            Told of the progress.

        Returns
        -------
        Selection
            The scenes, numbered from 1 in their ids.

        Raises
        ------
        InputError
            If there are not so many.
        """

    def quick(self) -> "SceneChoice":
        """A cheaper choice, for a first look."""
        return self


@dataclass(frozen=True)
class FilteredScenes(SceneChoice):
    """The first draws that pass a filter."""

    rule: CoarseFilter = CoarseFilter()

    def choose(
        self, family: SceneFamily, count: int, seed: int, report: Report = no_report
    ) -> Selection:
        """See `filtered_scenes`."""
        return filtered_scenes(family, count, seed, rule=self.rule, report=report)


@dataclass(frozen=True)
class ContrastingScenes(SceneChoice):
    """Scenes on which two models disagree, both ways (Bates et al., Experiment 2).

    A large pool of filtered candidates is screened with one deterministic run a liquid; the
    most promising are judged by the models; of these, half of the scenes chosen have a larger
    judgment by the first, half by the second (`choose_contrast`).

    Parameters
    ----------
    rule
        The filter.
    candidates
        Size of the pool.
    models
        Two models whose judgments are to disagree: the paper's uncertain IFEs.
    screens
        Names of the liquids of the cheap runs.
    confirm_factor
        How many times the scenes wanted go from the screen to the models.
    """

    rule: CoarseFilter = CONTRAST_FILTER
    candidates: int = 1000
    models: tuple[str, str] = ("water-ife", "honey-ife-1")
    screens: tuple[str, str] = ("water", "honey-exp2")
    confirm_factor: float = 2.5

    @property
    def judges(self) -> tuple[str, ...]:
        """See `SceneChoice.judges`."""
        return self.models

    def quick(self) -> SceneChoice:
        """A pool of 200."""
        return replace(self, candidates=min(self.candidates, 200))

    @property
    def stages(self) -> tuple[tuple[str, str], ...]:
        """See `SceneChoice.stages`."""
        models = " and ".join(self.models)
        return (
            *super().stages[:2],
            (
                "judged",
                f"by {models}: {self.confirm_factor:g} for each scene wanted, of the largest "
                f"contrast in pours of {self.rule.n_particles} particles with damping",
            ),
            ("chosen", f"by the largest contrast of {models}, half of them in either direction"),
        )

    def choose(
        self, family: SceneFamily, count: int, seed: int, report: Report = no_report
    ) -> Selection:
        """See `SceneChoice.choose`."""
        if self.candidates < count:
            raise InputError(f"candidates: expected at least {count} (the scenes wanted)")
        pool = filtered_scenes(family, self.candidates, seed, rule=self.rule, report=report)
        liquids = [resolve_liquid(name, pool.scenes[0]) for name in self.screens]
        screened = np.array(_screen(pool.scenes, liquids, self.rule, report))
        wanted = min(round(self.confirm_factor * count), self.candidates)
        scenes = [pool.scenes[k] for k in choose_contrast(screened[0], screened[1], wanted)]
        confirmed = np.array(_confirm(scenes, self.models, self.rule, report))
        chosen = choose_contrast(confirmed[0], confirmed[1], count)
        order = np.random.default_rng(seed).permutation(chosen)
        models = " and ".join(self.models)
        return Selection(
            numbered([scenes[k] for k in order], family.name),
            pool.drawn,
            pool.kept,
            left=(pool.drawn, pool.kept, len(scenes), count),
            figures={
                f"correlation of {models}": _correlation(*confirmed[:, chosen]),
                f"correlation of {models}, all candidates": _correlation(*screened),
            },
        )


def _screen(
    scenes: Sequence[Scene], liquids: Sequence[Liquid], rule: CoarseFilter, report: Report
) -> list[NDArray[np.float64]]:
    """Judgments of coarse runs, an array a liquid; the filter's runs are remembered."""
    words = f"screening with {' and '.join(liquid.name for liquid in liquids)}"
    judgments = outcomes_of(
        [rule.pour(scene, liquid) for liquid in liquids for scene in scenes],
        attrgetter("judgment"),
        settings=rule.settings,
        memory=REMEMBERED,
        progress=partial(report, words),
    )
    return np.split(np.array(judgments), len(liquids))


def _confirm(
    scenes: Sequence[Scene], names: Sequence[str], rule: CoarseFilter, report: Report
) -> list[NDArray[np.float64]]:
    """Judgments of models, an array a model."""
    requests = [JudgmentRequest(name, make_model(name), scenes, WATER) for name in names]
    words = f"confirming with {' and '.join(names)}"
    return judge_together(
        requests, 0, settings=rule.settings, report=lambda _, *count: report(words, *count)
    )


def choose_contrast(
    water: NDArray[np.float64], honey: NDArray[np.float64], count: int
) -> NDArray[np.int64]:
    """Choose scenes that spread along the anti-diagonal of water and honey judgments.

    The correlation of two judgments of equal spread is (var S - var D) / (var S +
    var D) with their sum S and difference D: it falls with contrast |D| and
    rises with differences in how much reaches the goal at all. Half of the scenes
    are those of the largest D - |S - S0|, half those of the largest -D - |S - S0|;
    S0 is the sum that serves the weaker half best.

    Parameters
    ----------
    water, honey
        Judgments of all candidates, shape [candidate_count].
    count
        How many to choose.

    Returns
    -------
    ndarray
        Indices, in ascending order.
    """
    difference, total = water - honey, water + honey
    best: tuple[float, NDArray[np.int64]] | None = None
    for middle in np.linspace(0.5, 1.5, 21):
        centred = np.abs(total - middle)
        more_water = np.argsort(-(difference - centred), kind="stable")[: (count + 1) // 2]
        left = np.setdiff1d(np.arange(len(water)), more_water)
        more_honey = left[np.argsort(difference[left] + centred[left], kind="stable")][: count // 2]
        chosen = np.sort(np.concatenate([more_water, more_honey]))
        correlation = _correlation(water[chosen], honey[chosen])
        if best is None or correlation < best[0]:
            best = correlation, chosen
    assert best is not None
    return best[1]


def _correlation(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    if len(a) < 2 or np.std(a) == 0.0 or np.std(b) == 0.0:
        return 1.0
    return float(np.corrcoef(a, b)[0, 1])

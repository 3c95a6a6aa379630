"""What an experiment is: all that a command must know of it, as data."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources.abc import Traversable
from typing import Any, NamedTuple

from pourcast.errors import InputError, unknown
from pourcast.models.registry import make_model
from pourcast.scenes.goals.registry import GOALS
from pourcast.scenes.liquids.registry import liquid_names
from pourcast.study.selection import CoarseFilter, SceneChoice, SceneFamily


class Published(NamedTuple):
    """A published correlation, and its 95 % interval."""

    r: float
    low: float
    high: float


@dataclass(frozen=True)
class PublishedResults:
    """What a paper reports of an experiment, to stand beside what is found.

    Parameters
    ----------
    source
        The paper.
    with_people
        Liquid of the trials -> model -> correlation with people's mean judgments.
    with_truth
        Ground truth -> model -> correlation with it over the scenes.
    split_half
        Liquid of the trials -> split-half correlation of participants.
    """

    source: str
    with_people: Mapping[str, Mapping[str, Published]] = field(default_factory=dict)
    with_truth: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    split_half: Mapping[str, Published] = field(default_factory=dict)


@dataclass(frozen=True)
class Experiment:
    """An experiment: its scenes, who judges what, and what it is compared with.

    Liquids are named as participants call them (``honey``); which liquid that is, the goal of
    the scenes decides (`pourcast.scenes.liquids`).

    Parameters
    ----------
    name
        Its name; that of its file.
    title
        What it is, in one line.
    heading
        What a report is headed with; by default its name.
    family
        What scenes are drawn from.
    choice
        How scenes are chosen among draws.
    goal
        Kind of the scenes' goal.
    scene_count, practice_count
        Scenes of a study that are judged, and that participants practise with.
    participants
        How many took part, or shall.
    groups
        Liquids that each group of participants sees.
    mirrored
        Liquids whose trials are shown in a mirror.
    grid
        What a whole reproduction sweeps: name of a grid that comes with pourcast, or a file.
    practice_filter
        Which draws may be practised with.
    observers
        Liquid -> model in simulated observers' heads; `water-ife` for any other.
    truths
        Liquid -> ground truth; for any other undamped SPH of the liquid that is shown.
    models
        What is compared with people unless it is said otherwise; by default all presets.
    words
        Texts over those of the language, as under ``[texts]`` in `experiment.toml`.
    published
        What was published of it.

    Raises
    ------
    InputError
        If a number is out of range, or a name is not known.
    """

    name: str
    title: str
    family: SceneFamily
    choice: SceneChoice
    goal: str
    scene_count: int
    practice_count: int
    participants: int
    groups: tuple[tuple[str, ...], ...]
    mirrored: tuple[str, ...] = ()
    grid: str | Traversable = "quick"
    heading: str = ""
    practice_filter: CoarseFilter = field(default_factory=CoarseFilter)
    observers: Mapping[str, str] = field(default_factory=dict)
    truths: Mapping[str, str] = field(default_factory=dict)
    models: tuple[str, ...] = ()
    words: Mapping[str, Any] = field(default_factory=dict)
    published: PublishedResults | None = None

    def __post_init__(self) -> None:
        for name, least in (("scene_count", 1), ("practice_count", 0), ("participants", 1)):
            found = getattr(self, name)
            if not isinstance(found, int) or found < least:
                raise InputError(
                    f"experiment {self.name!r}: {name}: expected a whole number, at least "
                    f"{least}, found {found}"
                )
        if self.goal not in GOALS.names():
            raise InputError(f"experiment {self.name!r}: goal: {unknown(self.goal, GOALS.names())}")
        if not self.groups or any(isinstance(g, str) or not g for g in self.groups):
            raise InputError(
                f"experiment {self.name!r}: groups: expected tuples of liquids, such as "
                f"(('water',), ('honey',)), found {self.groups!r}"
            )
        if any(len(set(group)) < len(group) for group in self.groups):
            raise InputError(f"experiment {self.name!r}: groups: a liquid is twice in a group")
        if strange := set(self.mirrored) - set(self.shown_liquids):
            raise InputError(f"experiment {self.name!r}: mirrored: no group sees {strange.pop()!r}")
        known = liquid_names()
        for liquid in (*self.shown_liquids, *self.mirrored, *self.observers, *self.truths):
            if liquid not in known:
                raise InputError(f"experiment {self.name!r}: liquid: {unknown(liquid, known)}")
        for spec in (*self.observers.values(), *self.truths.values(), *self.models):
            make_model(spec)

    @property
    def shown_liquids(self) -> tuple[str, ...]:
        """Liquids that any group sees, each once."""
        return tuple(dict.fromkeys(liquid for group in self.groups for liquid in group))

    def namesake(self, liquid: str) -> str | None:
        """Its own liquid that participants read of by the name of another.

        Examples
        --------
        >>> from pourcast.study.experiments.registry import EXPERIMENTS
        >>> EXPERIMENTS.get("exp1-v0").namesake("honey")
        'honey-exp1-v0'
        """
        if liquid in self.shown_liquids:
            return None
        words = self.words.get("liquids", {})
        alike = (own for own in self.shown_liquids if words.get(own, {}).get("name") == liquid)
        return next(alike, None)

    def observer_model(self, liquid: str) -> str:
        """Model in simulated observers' heads when they see a liquid."""
        return observer_model(self, liquid)

    def truth(self, liquid: str) -> str:
        """Spec of the ground truth of a liquid's trials."""
        return truth_of(self, liquid)


UNDAMPED = "ife:n_particles=200,damping_zeta=0,zeta_sigma=0"
"""Ground truth of whatever liquid a trial shows."""


def observer_model(experiment: Experiment | None, liquid: str) -> str:
    """Model in simulated observers' heads; of scenes that belong to no experiment, too."""
    return "water-ife" if experiment is None else experiment.observers.get(liquid, "water-ife")


def truth_of(experiment: Experiment | None, liquid: str) -> str:
    """Spec of the ground truth of a liquid's trials; of scenes of no experiment, too."""
    return UNDAMPED if experiment is None else experiment.truths.get(liquid, UNDAMPED)


def published_with_people(experiment: Experiment | None, liquid: str) -> Mapping[str, Published]:
    """Published correlations with people's judgments of a liquid's trials; empty if there are none.

    Examples
    --------
    >>> from pourcast.study.experiments.registry import EXPERIMENTS
    >>> published_with_people(EXPERIMENTS.get("exp1"), "water")["gravity"].r
    0.58
    """
    if experiment is None or experiment.published is None:
        return {}
    return experiment.published.with_people.get(liquid, {})

"""What there is to choose parameters from: models that were swept, on the trials people judged.

The paper's models are fitted as the paper says (`PAPER`); of any other model, all parameters of
which more than one value was swept.
"""

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pourcast.errors import InputError
from pourcast.models.registry import MODELS
from pourcast.scenes.liquids.registry import called
from pourcast.study.trials import Trials
from pourcast.sweep.judgments import OWN_ALPHA, Judgments

Array = NDArray[np.float64]


class PaperFit(NamedTuple):
    """How the paper fits a model.

    Parameters
    ----------
    liquid
        Of the trials.
    fixed
        What all its candidates have in common.
    axes
        Parameters in which they differ.
    free
        Those that are chosen on its own trials; the others are inherited.
    """

    liquid: str
    fixed: Mapping[str, Any]
    axes: tuple[str, ...]
    free: tuple[str, ...]


_IFE = ("n_particles", "viscosity_alpha", "damping_zeta")
_WATER_IN_HEAD = {"family": "ife", "imagined": "water", "zeta_sigma": 4}
_HONEY_IN_HEAD = {"family": "ife", "imagined": "honey", "zeta_sigma": 4}
_MARBLE, _MARBLE_AXES = {"family": "marble", "zeta_sigma": 4}, ("n_particles", "damping_zeta")
_SIMPLE, _SIMPLE_AXES = {"family": "simple", "m_sigma": 0.04}, ("g", "m")

PAPER: Mapping[str, PaperFit] = {
    "water-ife": PaperFit("water", _WATER_IN_HEAD, _IFE, _IFE),
    "honey-ife-1": PaperFit("honey", _HONEY_IN_HEAD, _IFE, ()),
    "honey-ife-2": PaperFit("honey", _WATER_IN_HEAD, _IFE, ("damping_zeta",)),
    "water-marble": PaperFit("water", _MARBLE, _MARBLE_AXES, _MARBLE_AXES),
    "honey-marble": PaperFit("honey", _MARBLE, _MARBLE_AXES, _MARBLE_AXES),
    "water-simple": PaperFit("water", _SIMPLE, _SIMPLE_AXES, _SIMPLE_AXES),
    "honey-simple": PaperFit("honey", _SIMPLE, _SIMPLE_AXES, _SIMPLE_AXES),
}
"""The models that the paper fits."""


FITTED = ":fitted"
"""Ends the names of models whose parameters were chosen on these responses."""


def is_fitted(name: str) -> bool:
    """Whether a name is that of a model whose parameters were chosen on these responses."""
    return name.endswith(FITTED)


def not_fitted(wanted: Sequence[str], there: Mapping[str, Collection[str]]) -> list[str]:
    """What is to be said of fitted models that were asked for, and aren't there for some liquid.

    Parameters
    ----------
    wanted
        Names of models that were asked for.
    there
        Liquid of the trials -> names of the models that there are.

    Examples
    --------
    >>> not_fitted(["a:fitted", "b"], {"water": ["a:fitted"], "honey": ["b"]})
    ['honey: a:fitted is not among the models: it was not fitted on these trials']
    """
    return [
        f"{liquid}: {name} is not among the models: it was not fitted on these trials"
        for liquid, names in there.items()
        for name in wanted
        if is_fitted(name) and name not in names
    ]


@dataclass(frozen=True)
class Candidates:
    """A model with several values of its parameters, and what people said on the same trials.

    Parameters
    ----------
    model
        Its name in tables.
    spec
        What all candidates have in common, as a spec.
    trials
        People's responses.
    axes
        Parameter -> its value in each candidate.
    free
        Parameters that are chosen on these trials; others are inherited.
    judgments
        Shape [candidate_count, scene_count].
    """

    model: str
    spec: str
    trials: Trials
    axes: Mapping[str, NDArray[Any]]
    free: tuple[str, ...]
    judgments: Array

    @property
    def fitted_name(self) -> str:
        """Name of the model with the parameters that are chosen on these responses."""
        return f"{self.model}{FITTED}"

    def at(self, **values: Any) -> NDArray[np.bool_]:
        """Candidates with these values."""
        same = np.ones(len(self.judgments), dtype=np.bool_)
        for axis, value in values.items():
            same &= self.axes[axis] == value
        return same

    def values(self, number: int) -> dict[str, Any]:
        """Parameters of one candidate."""
        return {axis: column[number] for axis, column in self.axes.items()}

    def spec_of(self, number: int) -> str:
        """Spec of one candidate."""
        own = in_words(self.values(number)).replace(f"={OWN_ALPHA}", "=none").replace(" ", "")
        return f"{self.spec},{own}" if ":" in self.spec else f"{self.spec}:{own}"


def in_words(values: Mapping[str, Any]) -> str:
    """Parameters and their values.

    Examples
    --------
    >>> in_words({"n_particles": 50.0, "liquid": "water"})
    'n_particles=50, liquid=water'
    """
    return ", ".join(f"{axis}={value_in_words(value)}" for axis, value in values.items())


_COLUMNS = frozenset(
    ("model", "fitted", "candidates", "r", "low", "high", "over", "ties", "flat", "paper",
     "r_paper", "spec", "simulated")
)  # fmt: skip
"""Columns of tables of chosen parameters that say something else than a parameter."""


def as_columns(values: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters by names that a table of chosen parameters has room for.

    Examples
    --------
    >>> as_columns({"liquid": "water", "blur": 0.1, "r": 2.0})
    {'imagined': 'water', 'blur': 0.1, 'model_r': 2.0}
    """
    named = {f"model_{axis}" if axis in _COLUMNS else axis: v for axis, v in values.items()}
    return {"imagined" if axis == "liquid" else axis: value for axis, value in named.items()}


def value_in_words(value: Any) -> str:
    """A parameter's value, as specs have it."""
    return str(value) if isinstance(value, str) else format(float(value), "g")


def words_first(value: Any) -> tuple[float, str]:
    """Sorts values of a parameter: words, then numbers."""
    return (-np.inf, value) if isinstance(value, str) else (float(value), "")


def candidates(judged: Judgments, trials: Sequence[Trials]) -> dict[str, Candidates]:
    """What there is to choose from, for each model with each liquid.

    Parameters
    ----------
    judged
        Judgments on the study's scenes.
    trials
        People's responses.

    Returns
    -------
    dict
        By the model's name; where several liquids were shown, those of models that the paper
        doesn't fit by name and liquid.
    """
    by_liquid = {called(one.liquid): (one, judged.on(one.scenes)) for one in trials}
    sets = {}
    for name, fit in PAPER.items():
        if fit.liquid in by_liquid:
            paper = _of_paper(*by_liquid[fit.liquid], name, fit)
            if len(paper.judgments):
                sets[name] = paper
    known = {(PAPER[name].fixed["family"], PAPER[name].liquid) for name in sets}
    for liquid, (one, there) in by_liquid.items():
        for rival in _others(one, there, [family for family, of in known if of == liquid]):
            sets[rival.model if len(trials) == 1 else f"{rival.model} ({liquid})"] = rival
    return sets


def _of_paper(trials: Trials, there: Judgments, name: str, fit: PaperFit) -> Candidates:
    rows = there.on_trials(trials.liquid, **fit.fixed)
    columns = {axis: there.rows[axis].to_numpy()[rows] for axis in fit.axes if len(rows)}
    return Candidates(name, name, trials, columns, fit.free, there.judgments[rows])


def _others(trials: Trials, there: Judgments, known: Sequence[str]) -> Iterator[Candidates]:
    """All other families of which more than one member was swept."""
    for family in dict.fromkeys(there.rows["family"]):
        if family in known:
            continue
        rows = there.on_trials(trials.liquid, family=family)
        members = [json.loads(text) for text in there.rows["parameters"].iloc[rows]]
        columns = {name: _column([member[name] for member in members]) for name in _all(members)}
        axes = {name: column for name, column in columns.items() if len(set(column)) > 1}
        if axes:
            spec = _with_constants(family, columns, axes)
            judgments = there.judgments[rows]
            yield Candidates(family, spec, trials, axes, tuple(axes), judgments)


def _all(members: Sequence[Mapping[str, Any]]) -> list[str]:
    """Parameters that all members have: versions of a package may differ in them."""
    return [name for name in (members or [{}])[0] if all(name in member for member in members)]


def _column(values: Sequence[Any]) -> NDArray[Any]:
    words = ["none" if value is None else value for value in values]
    numeric = all(isinstance(value, int | float) for value in words)
    return np.array(words, dtype=float if numeric else object)


def _with_constants(
    family: str, columns: Mapping[str, NDArray[Any]], axes: Mapping[str, NDArray[Any]]
) -> str:
    """Spec of a family with what all its candidates have in common, where it isn't as usual."""
    usual = _defaults(family)
    constants = {
        name: column[0]
        for name, column in columns.items()
        if name not in axes and column[0] != usual.get(name, np.nan)
    }
    return f"{family}:{in_words(constants).replace(' ', '')}" if constants else family


def _defaults(family: str) -> dict[str, Any]:
    """Defaults of a model's parameters; none if it isn't installed any more."""
    try:
        found = {entry.name: entry.default for entry in fields(MODELS.get(family))}
    except InputError:
        return {}
    return {name: "none" if value is None else value for name, value in found.items()}

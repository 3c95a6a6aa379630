"""Experiments by name: the files of this folder, and those of other packages.

An installed package adds one by an entry point of the group ``pourcast.experiments`` that names
an `Experiment`.
"""

from collections.abc import Sequence
from typing import Any

from pourcast.errors import InputError
from pourcast.registry import Registry
from pourcast.scenes.scene import Scene
from pourcast.study.experiments.base import Experiment


def _checked(name: str, member: Any) -> Experiment:
    if not isinstance(member, Experiment):
        raise InputError(f"experiment {name!r}: expected a pourcast.Experiment, found {member!r}")
    if member.name != name:
        raise InputError(f"experiment {name!r}: its name should be {name!r}, not {member.name!r}")
    return member


EXPERIMENTS = Registry(
    "experiment", "pourcast.study.experiments", "EXPERIMENT", "pourcast.experiments", _checked
)
"""All experiments."""


def experiment_like(scenes: Sequence[Scene]) -> Experiment | None:
    """First experiment that asks what these scenes ask, for scenes that belong to none."""
    kinds = {scene.goal.kind for scene in scenes}
    experiments, _ = EXPERIMENTS.all()
    return next((one for one in experiments.values() if kinds == {one.goal}), None)

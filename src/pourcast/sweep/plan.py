"""A grid over scenes, cut into shards of about a minute's work.

The cut depends on the grid and the scenes alone, not on the machine, on the
number of workers or on what is done already: two processes that sweep the same
grid cut it alike, and `--shard 17` is always the same work.
"""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pourcast.errors import InputError
from pourcast.models.base import SimulationModel, averages_pours
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import resolve_liquid
from pourcast.scenes.scene import Scene
from pourcast.simulation.settings import EngineSettings
from pourcast.sweep.cost import simulated_seconds
from pourcast.sweep.grid import Grid, GridPoint
from pourcast.sweep.settings import JudgeSetting, PourSetting, Setting, digest, goal_version

LONGEST_SHARD = 60.0
"""Work in a shard of a large grid [s of one core]."""

SHORTEST_SHARD = 3.0
"""Least work in a shard [s of one core]: at the end of each the engine's lanes run empty,
which takes it 0.1 to 0.3 s."""

SHARE_OF_REST = 1 / 6
"""Share of what is left that the next shard takes, within these bounds: shards become
smaller towards the end, so that all workers end together."""

TILE = 32
"""Scenes that are taken together: a shard carries few scenes and many settings, long pours
and short ones, so that short ones come last, when the lanes run empty."""

TRAJECTORY_BYTES = 128e6
"""Most bytes of trajectories in a shard, roughly."""

DoneScenes = dict[int, NDArray[np.bool_]]
"""Setting -> which scenes are done elsewhere."""


class Span(NamedTuple):
    """One setting in the scenes from `start` up to, not including, `stop`."""

    setting: int
    start: int
    stop: int


@dataclass(frozen=True, slots=True)
class Shard:
    """A piece of work.

    Parameters
    ----------
    id
        Hash of all that determines its result.
    number
        Its number in the plan, from 0.
    spans
        What is in it.
    seconds
        Rough time on one core [s].
    simulations
        Number of simulations; a judgment without any counts as one.
    """

    id: str
    number: int
    spans: tuple[Span, ...]
    seconds: float
    simulations: int


class Row(NamedTuple):
    """A setting and the scenes that it is for; what one scene costs."""

    setting: int
    start: int
    stop: int
    seconds: float
    simulations: int


@dataclass(frozen=True)
class Answer:
    """How a model's judgments are put together: the mean over some settings."""

    point: GridPoint
    trial_liquid: str
    settings: tuple[int, ...]
    start: int
    """First scene that it is for; `stop` is the one after the last."""
    stop: int


@dataclass(frozen=True)
class Plan:
    """What a grid over scenes needs.

    Parameters
    ----------
    grid
        The grid.
    listed
        The study's scenes, in their order.
    scenes
        The different ones among them, those with the same kind of goal together.
    settings
        What is computed, in the order in which it is.
    rows
        Which setting is for which scenes.
    answers
        The models' judgments from the settings'.
    """

    grid: Grid
    listed: tuple[Scene, ...]
    scenes: tuple[Scene, ...]
    settings: tuple[Setting, ...]
    rows: tuple[Row, ...]
    answers: tuple[Answer, ...]

    @property
    def trajectories(self) -> bool:
        """Whether particles' paths are kept."""
        return self.grid.content.trajectories

    @cached_property
    def simulations(self) -> int:
        """Number of simulations in all."""
        return sum((row.stop - row.start) * row.simulations for row in self.rows)

    @cached_property
    def seconds(self) -> float:
        """Rough work in all [s of one core]."""
        return sum((row.stop - row.start) * row.seconds for row in self.rows)

    @cached_property
    def scene_digests(self) -> tuple[str, ...]:
        """Digest of each of `scenes`."""
        return tuple(scene.digest for scene in self.scenes)

    @cached_property
    def goal_versions(self) -> tuple[str, ...]:
        """State of the code of the goal of each of `scenes`."""
        return tuple(goal_version(type(scene.goal)) for scene in self.scenes)

    @cached_property
    def shards(self) -> tuple[Shard, ...]:
        """The work, cut into pieces."""
        return tuple(self._identified(k, spans) for k, spans in enumerate(self._cut()))

    def _cut(self) -> Iterator[list[Span]]:
        open_spans: list[Span] = []
        load, left, group = 0.0, self.seconds, None
        target = self._next_target(left)
        for row, span in self._tiles():
            here = self.settings[span.setting].group
            # A model that judges by itself shares no shard: if it fails, nothing else does.
            alone = isinstance(self.settings[span.setting], JudgeSetting)
            if open_spans and here != group and (alone or load > target / 2):
                yield open_spans
                open_spans, load, target = [], 0.0, self._next_target(left)
            group, position = here, span.start
            cost = row.seconds + self._trajectory_load(row) * target
            while position < span.stop:
                room = max(1, round((target - load) / cost))
                stop = min(span.stop, position + room)
                open_spans.append(Span(span.setting, position, stop))
                load += (stop - position) * cost
                left -= (stop - position) * row.seconds
                position = stop
                if load >= target - cost / 2:
                    yield open_spans
                    open_spans, load, target = [], 0.0, self._next_target(left)
        if open_spans:
            yield open_spans

    def _next_target(self, left: float) -> float:
        """Work in the next shard, if so much is left [s of one core]."""
        fixed = self.grid.content.shard_seconds
        return fixed or min(max(SHARE_OF_REST * left, SHORTEST_SHARD), LONGEST_SHARD)

    def _tiles(self) -> Iterator[tuple[Row, Span]]:
        """All rows, tile of scenes by tile within each group."""
        begin = 0
        for end in range(1, len(self.rows) + 1):
            group = self.settings[self.rows[begin].setting].group
            if end < len(self.rows) and self.settings[self.rows[end].setting].group == group:
                continue
            rows, begin = self.rows[begin:end], end
            for first in range(0, len(self.scenes), TILE):
                for row in rows:
                    start, stop = max(row.start, first), min(row.stop, first + TILE)
                    if start < stop:
                        yield row, Span(row.setting, start, stop)

    def _trajectory_load(self, row: Row) -> float:
        """Share of a shard's room for trajectories that a scene takes."""
        setting = self.settings[row.setting]
        if not self.trajectories or not isinstance(setting, PourSetting):
            return 0.0
        return trajectory_bytes(setting) / TRAJECTORY_BYTES

    def _identified(self, number: int, spans: Sequence[Span]) -> Shard:
        spans = sorted(spans)
        name = hashlib.sha256(b"trajectories" if self.trajectories else b"")
        for setting, start, stop in spans:
            name.update(self._setting_digests[setting])
            name.update("".join(self._scene_names[start:stop]).encode())
        return Shard(name.hexdigest()[:20], number, tuple(spans), *self.work_in(spans))

    def work_in(self, spans: Sequence[Span]) -> tuple[float, int]:
        """Rough work [s of one core] and number of simulations in some spans."""
        rows = [(span.stop - span.start, self._row_of[span.setting]) for span in spans]
        seconds = sum(count * row.seconds for count, row in rows)
        return seconds, sum(count * row.simulations for count, row in rows)

    @cached_property
    def _scene_names(self) -> list[str]:
        return [f"{a} {b} " for a, b in zip(self.scene_digests, self.goal_versions, strict=True)]

    @cached_property
    def _setting_digests(self) -> list[bytes]:
        return [digest(setting) for setting in self.settings]

    @cached_property
    def _row_of(self) -> dict[int, Row]:
        return {row.setting: row for row in self.rows}

    def without(self, shard: Shard, done: DoneScenes) -> Shard | None:
        """What is left of a shard when some of it is done elsewhere; None if nothing is."""
        left: list[Span] = []
        for span in shard.spans:
            mask = done.get(span.setting)
            if mask is None or not mask[span.start : span.stop].any():
                left.append(span)
                continue
            edges = np.flatnonzero(np.diff(mask[span.start : span.stop], prepend=1, append=1))
            left += [
                Span(span.setting, span.start + int(first), span.start + int(last))
                for first, last in zip(edges[::2], edges[1::2], strict=True)
            ]
        if left == list(shard.spans):
            return shard
        return self._identified(shard.number, left) if left else None


def trajectory_bytes(setting: PourSetting) -> float:
    """Size of a pour's trajectory in memory [bytes], roughly."""
    duration = simulated_seconds(setting.liquid, setting.n_particles, setting.damping_zeta)
    return 12.0 * setting.n_particles * duration * EngineSettings().frame_rate


def make_plan(grid: Grid, scenes: Sequence[Scene], engine: EngineSettings | None = None) -> Plan:
    """Find out what a grid over scenes needs.

    Parameters
    ----------
    grid
        The grid.
    scenes
        The study's scenes.
    engine
        How pours are computed; by default with the settings as they come.

    Raises
    ------
    InputError
        If `engine` is given, and a model runs pours that nobody else can set.
    """
    engine = engine or EngineSettings()
    different = {scene.digest: scene for scene in scenes}
    ordered = sorted(different.values(), key=lambda scene: scene.goal.kind)
    kinds = [scene.goal.kind for scene in ordered]
    parts = [
        (kinds.index(kind), kinds.index(kind) + kinds.count(kind)) for kind in dict.fromkeys(kinds)
    ]
    parts_of: dict[Setting, set[tuple[int, int]]] = {}
    wanted: list[tuple[GridPoint, str, list[Setting], tuple[int, int]]] = []
    for point in grid.points():
        for part in parts:
            needed, liquid = _needed(point, ordered[part[0]], grid.own, engine)
            for setting in needed:
                parts_of.setdefault(setting, set()).add(part)
            wanted.append((point, liquid, needed, part))
    settings = tuple(sorted(parts_of, key=lambda setting: setting.order))
    number = {setting: k for k, setting in enumerate(settings)}
    rows = [
        Row(k, *part, setting.seconds(ordered[part[0]]), setting.simulations(ordered[part[0]]))
        for k, setting in enumerate(settings)
        for part in sorted(parts_of[setting])
    ]
    answers = (
        Answer(point, liquid, tuple(number[setting] for setting in needed), *part)
        for point, liquid, needed, part in wanted
    )
    return Plan(grid, tuple(scenes), tuple(ordered), settings, tuple(rows), tuple(answers))


def _needed(
    point: GridPoint, scene: Scene, own: Sequence[Liquid], engine: EngineSettings
) -> tuple[list[Setting], str]:
    """Settings of a model for scenes like this one, and the trial's liquid."""
    liquid, model = resolve_liquid(point.liquid, scene, own), point.model
    if averages_pours(model) and model.same_pours_everywhere:
        pours = model.pours(scene, liquid)
        return [PourSetting.of(pour, engine) for pour in pours], liquid.name
    runs_pours_itself = isinstance(model, SimulationModel) and not averages_pours(model)
    if runs_pours_itself and engine != EngineSettings():
        raise InputError(f"model {point.name!r} runs its pours itself: no engine can be set for it")
    return [JudgeSetting(point.family, model, liquid, point.seed, engine)], liquid.name

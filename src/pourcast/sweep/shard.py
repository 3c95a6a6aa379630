"""A worker's part: do one shard, and keep the result."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa

from pourcast.errors import StoreError
from pourcast.models.base import judge_checked
from pourcast.scenes.scene import Scene
from pourcast.simulation.pour import Outcome, Pour
from pourcast.simulation.run import simulate
from pourcast.simulation.settings import EngineSettings
from pourcast.sweep.plan import Plan, Shard, Span
from pourcast.sweep.settings import JudgeSetting, Setting, goal_version
from pourcast.sweep.store import SCHEMA, Store, version_of_row
from pourcast.sweep.task import OnWork, TaskResult, no_work, told
from pourcast.sweep.trajectories import write_trajectories

OnDone = Callable[[int], None]
"""Called with the number of simulations that were done since the last call."""


def nobody(done: int) -> None:
    """Tell nobody."""


@dataclass(frozen=True)
class ShardTask:
    """A shard with all that a worker needs for it, on this machine or another.

    Parameters
    ----------
    shard
        The shard; its spans count in `settings` and `scenes` below.
    store
        Folder of the store; the worker sees it under the same name.
    settings, scenes, digests
        Those that occur in the shard, and the scenes' digests.
    versions
        State of the code of each setting, and of each scene's goal, where it was planned.
    trajectories
        Whether to keep the particles' paths.
    """

    shard: Shard
    store: Path
    settings: tuple[Setting, ...]
    scenes: tuple[Scene, ...]
    digests: tuple[str, ...]
    versions: tuple[tuple[str, ...], tuple[str, ...]]
    trajectories: bool

    @property
    def id(self) -> str:
        """Name of the shard."""
        return self.shard.id

    def run(self, on_work: OnWork = no_work) -> TaskResult:
        """Do the shard; see `run_shard`."""
        each = self.shard.seconds / self.shard.simulations
        return run_shard(self, lambda done: on_work(done, done * each))


def task_of(plan: Plan, shard: Shard, store: Path) -> ShardTask:
    """A shard with only those settings and scenes that occur in it."""
    settings = sorted({span.setting for span in shard.spans})
    scenes = sorted({k for span in shard.spans for k in range(span.start, span.stop)})
    setting_index = dict(zip(settings, count(), strict=False))
    scene_index = dict(zip(scenes, count(), strict=False))
    # A span's scenes are all in `scenes`, hence still side by side.
    spans = tuple(
        Span(setting_index[setting], scene_index[start], scene_index[stop - 1] + 1)
        for setting, start, stop in shard.spans
    )
    return ShardTask(
        shard=Shard(shard.id, shard.number, spans, shard.seconds, shard.simulations),
        store=store.absolute(),
        settings=tuple(plan.settings[k] for k in settings),
        scenes=tuple(plan.scenes[k] for k in scenes),
        digests=tuple(plan.scene_digests[k] for k in scenes),
        versions=(
            tuple(plan.settings[k].version for k in settings),
            tuple(plan.goal_versions[k] for k in scenes),
        ),
        trajectories=plan.trajectories,
    )


def run_shard(task: ShardTask, on_done: OnDone = nobody) -> TaskResult:
    """Do a shard unless it is done or somebody is at it; never raises an ordinary error.

    Parameters
    ----------
    task
        The shard.
    on_done
        Told of the progress.
    """
    store, name = Store(task.store), task.shard.id
    try:
        with store.locked(name) as mine:
            if not mine:
                return TaskResult(name, "busy")
            if store.path_of(name) is None:
                _do(task, store, on_done)
            store.forget_failure(name)
    except StoreError as error:
        return TaskResult(name, "store", str(error))
    except Exception as error:
        return TaskResult(name, "failed", told(error))
    return TaskResult(name, "done")


class _Row(NamedTuple):
    """A row of a shard's table before it is done."""

    scene: int
    setting: int
    draw: int
    pour: Pour | None


def _do(task: ShardTask, store: Store, on_done: OnDone) -> None:
    here = (
        tuple(setting.version for setting in task.settings),
        tuple(goal_version(type(scene.goal)) for scene in task.scenes),
    )
    if task.versions != here:
        raise RuntimeError("the worker has another version of pourcast than the planner")
    table, outcomes = compute(task, on_done=on_done)
    if task.trajectories and any(outcomes):
        write_trajectories(store, task.shard.id, outcomes, EngineSettings().frame_rate)
    store.write(task.shard.id, table)


def compute(
    task: ShardTask, *, threads: int = 1, on_done: OnDone = nobody
) -> tuple[pa.Table, list[Outcome | None]]:
    """Do the work of a shard, and keep nothing.

    Parameters
    ----------
    task
        The shard.
    threads
        Threads for its simulations; the result doesn't depend on them.
    on_done
        Told of the progress.

    Returns
    -------
    table, outcomes
        The shard's table (`store.SCHEMA`), and for each row the pour's outcome, if it was one.
    """
    rows = list(_rows(task))
    seen = 0

    def progress(done: int, _total: int) -> None:
        nonlocal seen
        on_done(max(done - seen, 0))  # It begins with 0, for each of the engine settings.
        seen = done

    outcomes: list[Outcome | None] = [None] * len(rows)
    for engine in dict.fromkeys(setting.engine for setting in task.settings):
        members = [
            k
            for k, row in enumerate(rows)
            if row.pour is not None and task.settings[row.setting].engine == engine
        ]
        pours = [pour for k in members if (pour := rows[k].pour) is not None]
        ends = simulate(
            pours, settings=engine, record=task.trajectories, threads=threads, progress=progress
        )
        for k, end in zip(members, ends, strict=True):
            outcomes[k] = end
    judgments = _judgments(task, rows, on_done)
    return _table(task, rows, outcomes, judgments), outcomes


def _rows(task: ShardTask) -> Iterator[_Row]:
    for setting_index, start, stop in task.shard.spans:
        setting = task.settings[setting_index]
        for scene in range(start, stop):
            pours = setting.pours_in(task.scenes[scene])
            for draw, pour in enumerate(pours or [None]):
                yield _Row(scene, setting_index, draw, pour)


def _judgments(
    task: ShardTask, rows: Sequence[_Row], on_done: OnDone
) -> dict[tuple[int, int], float]:
    """Judgments of the models that don't pour: (setting, scene) -> value."""
    asked: dict[int, list[int]] = {}
    for row in rows:
        if row.pour is None:
            asked.setdefault(row.setting, []).append(row.scene)
    values_of = {}
    for index, members in asked.items():
        setting = task.settings[index]
        assert isinstance(setting, JudgeSetting)
        scenes = [task.scenes[k] for k in members]
        values = judge_checked(setting.model, setting.name, scenes, setting.liquid, setting.seed)
        values_of.update({(index, k): float(v) for k, v in zip(members, values, strict=True)})
        on_done(len(members))
    return values_of


def _table(
    task: ShardTask,
    rows: Sequence[_Row],
    outcomes: Sequence[Outcome | None],
    judgments: dict[tuple[int, int], float],
) -> pa.Table:
    identities = [setting.identity for setting in task.settings]
    settings, goals = task.versions
    versions = [version_of_row(settings[row.setting], goals[row.scene]) for row in rows]
    columns = {
        "scene": pa.DictionaryArray.from_arrays(
            pa.array([row.scene for row in rows], pa.int32()), pa.array(task.digests)
        ),
        "setting": pa.DictionaryArray.from_arrays(
            pa.array([row.setting for row in rows], pa.int32()), pa.array(identities)
        ),
        "engine": pa.array(versions).dictionary_encode(),
        "draw": [row.draw for row in rows],
        "judgment": [
            judgments[row.setting, row.scene] if outcome is None else outcome.judgment
            for row, outcome in zip(rows, outcomes, strict=True)
        ],
        **{
            name: [None if outcome is None else getattr(outcome, name) for outcome in outcomes]
            for name in ("stranded", "touched", "time", "settled")
        },
    }
    metadata = {"trajectories": str(int(task.trajectories))}
    return pa.table(columns, schema=SCHEMA.with_metadata(metadata))

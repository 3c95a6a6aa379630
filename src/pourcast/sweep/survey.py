"""What of a plan is done, and what is left."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pourcast.sweep.plan import DoneScenes, Plan, Shard
from pourcast.sweep.store import Damage, Store, version_of_row


@dataclass(frozen=True)
class Survey:
    """What of a plan is done, and what is left.

    Parameters
    ----------
    left
        Work that is left; a shard that an older grid did in part is cut down to the rest.
    files
        Files of whatever is done of it, by their shards' ids; of other grids' shards too.
    damaged
        Files that are there but not as they were written.
    """

    left: tuple[Shard, ...]
    files: dict[str, Path]
    damaged: tuple[Damage, ...]

    @property
    def simulations(self) -> int:
        """Simulations that are left."""
        return sum(shard.simulations for shard in self.left)


def survey(plan: Plan, store: Store, shards: Sequence[Shard] | None = None) -> Survey:
    """Look through a store; every file's checksum is checked, and nothing is changed.

    Parameters
    ----------
    plan
        What is wanted.
    store
        What there is.
    shards
        Those of the plan's shards to look for; all by default.
    """
    shards = plan.shards if shards is None else shards
    paths = store.paths()
    for other in {shard.id for shard in plan.shards} - {shard.id for shard in shards}:
        paths.pop(other, None)
    damaged = store.damaged(paths) + _without_paths(plan, store, shards, paths)
    for damage in damaged:
        paths.pop(damage.shard, None)
    files = {shard.id: paths.pop(shard.id) for shard in shards if shard.id in paths}
    left = [shard for shard in shards if shard.id not in files]
    if left and paths:
        elsewhere = _Elsewhere(plan)
        files |= {name: path for name, path in paths.items() if elsewhere.adds(store.read(path))}
        rest = [plan.without(shard, elsewhere.done) for shard in left]
        left = [shard for shard in rest if shard is not None]
    return Survey(tuple(left), files, tuple(damaged))


def _without_paths(
    plan: Plan, store: Store, shards: Sequence[Shard], paths: dict[str, Path]
) -> list[Damage]:
    """Shards whose table is there, but whose trajectories are gone."""
    if not plan.trajectories:
        return []
    poured = {k for k, setting in enumerate(plan.settings) if setting.pours_in(plan.scenes[0])}
    there = store.trajectory_paths()
    return [
        Damage(shard.id, store.trajectories / f"{shard.id}-*.zarr.zip", "gone")
        for shard in shards
        if shard.id in paths
        and shard.id not in there
        and any(span.setting in poured for span in shard.spans)
    ]


class _Elsewhere:
    """What other grids' shards hold of a plan."""

    def __init__(self, plan: Plan) -> None:
        self.done: DoneScenes = {}
        self._plan = plan
        self._rows = PlannedRows(plan)

    def adds(self, table: pa.Table | None) -> bool:
        """Take in a shard; whether it holds anything that is wanted."""
        if table is None or not self._fits(table):
            return False
        settings, scenes, wanted = self._rows.find(table)
        for setting in np.unique(settings[wanted]):
            mask = self.done.setdefault(
                int(setting), np.zeros(len(self._plan.scenes), dtype=np.bool_)
            )
            mask[scenes[wanted & (settings == setting)]] = True
        return bool(wanted.any())

    def _fits(self, table: pa.Table) -> bool:
        return not self._plan.trajectories or table.schema.metadata[b"trajectories"] == b"1"


class PlannedRows:
    """Finds rows of shards' tables in a plan."""

    def __init__(self, plan: Plan) -> None:
        self._settings = {setting.identity: k for k, setting in enumerate(plan.settings)}
        self._scenes = {name: k for k, name in enumerate(plan.scene_digests)}
        of_settings, of_goals = [one.version for one in plan.settings], plan.goal_versions
        pairs = itertools.product(dict.fromkeys(of_settings), dict.fromkeys(of_goals))
        self._versions = {version_of_row(*pair): k for k, pair in enumerate(pairs)}
        goals = list(dict.fromkeys(of_goals))
        first = {version: k for k, version in enumerate(dict.fromkeys(of_settings))}
        self._of_settings = np.array([first[one] * len(goals) for one in of_settings], np.int64)
        self._of_scenes = np.array([goals.index(one) for one in of_goals], np.int64)

    def find(
        self, table: pa.Table
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
        """Number of each row's setting and scene in the plan, and whether the plan wants it.

        A row whose code has changed since is not wanted.
        """
        settings = indices_of(table["setting"], self._settings)
        scenes = indices_of(table["scene"], self._scenes)
        versions = indices_of(table["engine"], self._versions)
        expected = self._of_settings[settings] + self._of_scenes[scenes]
        return settings, scenes, (settings >= 0) & (scenes >= 0) & (versions == expected)


def indices_of(column: pa.ChunkedArray, known: dict[str, int]) -> NDArray[np.int64]:
    """Numbers of a dictionary column's values; -1 for what is not known."""
    parts: list[NDArray[np.int64]] = [
        np.array([known.get(name, -1) for name in chunk.dictionary.to_pylist()], np.int64)[
            chunk.indices.to_numpy()
        ]
        for chunk in column.chunks
    ]
    return np.concatenate([np.empty(0, np.int64), *parts])

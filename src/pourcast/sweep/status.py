"""How far the sweeps of a study are; asked from another shell, or the next morning."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.scene import Scene
from pourcast.sweep.grid import parse_grid
from pourcast.sweep.plan import Plan, make_plan
from pourcast.sweep.store import Damage, Failure, Store
from pourcast.sweep.survey import survey


@dataclass(frozen=True)
class Status:
    """How far a sweep is."""

    grid: str
    shards: int
    done_shards: int
    simulations: int
    done_simulations: int
    running: int
    """Shards that some process works on now."""
    last_written: str | None
    """When the last of its shards was finished, UTC."""
    failures: tuple[Failure, ...]
    damaged: tuple[Damage, ...]


def status_of(plan: Plan, store: Store) -> Status:
    """How far a plan is; changes nothing.

    Parameters
    ----------
    plan
        What is wanted.
    store
        What there is.
    """
    state = survey(plan, store)
    left = {shard.id for shard in state.left}
    times = [path.stat().st_mtime for path in state.files.values() if path.exists()]
    last = datetime.fromtimestamp(max(times), UTC).isoformat(" ", "seconds") if times else None
    return Status(
        grid=plan.grid.name,
        shards=len(plan.shards),
        done_shards=len(plan.shards) - len(state.left),
        simulations=plan.simulations,
        done_simulations=plan.simulations - state.simulations,
        running=len(left & set(store.locks_held())),
        last_written=last,
        failures=tuple(store.failures(left)),
        damaged=state.damaged,
    )


def all_statuses(store: Store, scenes: Sequence[Scene], own: Sequence[Liquid] = ()) -> list[Status]:
    """How far all sweeps are that were begun in a study.

    Parameters
    ----------
    store
        The study's store.
    scenes
        Its scenes.
    own
        The study's own liquids.
    """
    grids = [
        parse_grid(path.read_text(encoding="utf-8"), path.stem, str(path), own)
        for path in store.grids()
    ]
    return [status_of(make_plan(grid, scenes), store) for grid in grids]

"""Making a study's stimuli: what is missing, in parallel, from where it stopped."""

from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path

from pydantic import ValidationError

from pourcast.engine.batch import available_cores
from pourcast.errors import InputError, StoreError
from pourcast.progress import Report
from pourcast.stimuli.cycles import find_blender
from pourcast.stimuli.manifest import (
    Manifest,
    Stimulus,
    StimulusSet,
    Wanted,
    read_set,
    set_folder,
    write_set,
)
from pourcast.stimuli.recipe import CyclesRecipe, Recipe
from pourcast.stimuli.task import WORK, StimulusTask
from pourcast.sweep.executors import Executor
from pourcast.sweep.executors.local import LocalExecutor
from pourcast.sweep.task import TaskResult

_WORTH_PROCESSES = 3
"""So many films pay for the start of other processes."""


def make_stimuli(
    study: Path,
    wanted: Sequence[Wanted],
    recipe: Recipe,
    *,
    replace: bool = False,
    workers: int | None = None,
    open_executor: Callable[[], Executor] | None = None,
    report: Report | None = None,
) -> StimulusSet:
    """Make those stimuli that are not there yet.

    Parameters
    ----------
    study
        The study folder.
    wanted
        What is to be shown.
    recipe
        How stimuli are made; its name is the set's.
    replace
        Whether to begin a set anew that was made by another recipe.
    workers
        Stimuli at a time; the others' cores are shared. All cores by default; one for Cycles,
        which uses all of them by itself.
    open_executor
        Where it is done; processes of this machine by default.
    report
        Told of the progress.

    Returns
    -------
    StimulusSet
        All stimuli of the set. Its list is written after every stimulus, and pictures that were
        rendered stay, so that interrupted work goes on where it was.

    Raises
    ------
    InputError
        If the set was made by another recipe, or Blender is needed and isn't there.
    StoreError
        If some stimuli could not be made; the others are.
    """
    folder = set_folder(study, recipe.name)
    found = _opened(folder, recipe, replace)
    needed: dict[tuple[str, str], Wanted] = {}
    for one in wanted:  # groups that see the same are shown the same files
        key = (one.scene.digest, one.liquid)
        if one.film or key not in needed:
            needed[key] = one
    missing = [one for one in needed.values() if not found.has(one)]
    if not missing:
        return found
    rendered = isinstance(recipe.look, CyclesRecipe)
    if rendered:
        find_blender()
    count = workers or (1 if rendered else available_cores())
    threads = max(1, available_cores() // count) if open_executor is None else None
    tasks = [StimulusTask(folder.absolute(), one, recipe, threads) for one in missing]
    films = sum(one.film for one in missing)
    if open_executor is None and not rendered and films < _WORTH_PROCESSES:
        return _driven(found, tasks, None, report)
    with closing(open_executor() if open_executor else LocalExecutor(count)) as executor:
        return _driven(found, tasks, executor, report)


def _opened(folder: Path, recipe: Recipe, replace: bool) -> StimulusSet:
    """The set as far as it is there."""
    found = read_set(folder)
    if found is not None and found.manifest.recipe != recipe:
        if not replace:
            difference = _difference(found.manifest.recipe, recipe)
            raise InputError(
                f"{folder}: made with other settings ({difference}); --replace makes all its "
                "stimuli anew"
            )
        found = None
    if found is None:
        _forget_work(folder)
        found = StimulusSet(folder, Manifest(recipe=recipe))
        write_set(found)
    return _gathered(found)


def _difference(old: Recipe, new: Recipe) -> str:
    """First setting in which two recipes of one name differ."""
    one = old.model_dump() | old.flow.model_dump() | old.look.model_dump()
    other = new.model_dump() | new.flow.model_dump() | new.look.model_dump()
    for name in one:
        if name not in ("flow", "look") and one[name] != other[name]:
            return f"{name} {one[name]}, not {other[name]}"
    return "an older version's"


def _forget_work(folder: Path) -> None:
    """Remove what another recipe left unfinished."""
    for path in sorted((folder / WORK).rglob("*"), reverse=True):
        if path.is_dir():
            path.rmdir()
        else:
            path.unlink()


def _gathered(found: StimulusSet) -> StimulusSet:
    """Put finished stimuli into the list that a worker left beside it."""
    there = {(one.scene, one.liquid): one for one in found.manifest.stimuli}
    entries = sorted((found.folder / WORK).glob("*.json"))
    if not entries:
        return found
    for path in entries:
        try:
            stimulus = Stimulus.model_validate_json(path.read_bytes())
        except ValidationError:
            continue  # of another version; it will be made again
        there[stimulus.scene, stimulus.liquid] = stimulus
    manifest = found.manifest.model_copy(update={"stimuli": tuple(there.values())})
    gathered = StimulusSet(found.folder, manifest)
    write_set(gathered)
    for path in entries:
        path.unlink()
    return gathered


def _driven(
    found: StimulusSet, tasks: list[StimulusTask], executor: Executor | None, report: Report | None
) -> StimulusSet:
    """Do tasks, and list each stimulus as soon as it is there."""
    rendered = isinstance(found.manifest.recipe.look, CyclesRecipe)
    left = {task.id: task for task in tasks}
    total = sum(task.picture_count for task in tasks) if rendered else len(tasks)
    done = 0

    def tell() -> None:
        if report is not None and rendered:
            under_way = sum(min(t.pictures_done, t.picture_count) for t in left.values())
            report("rendering pictures", min(total, done + under_way), total)
        elif report is not None:
            report("making stimuli", done, total)

    def heartbeat(_simulations: int, _seconds: float) -> None:
        if rendered:
            tell()

    tell()
    results = executor.run(tasks, heartbeat) if executor else (task.run() for task in tasks)
    failures: list[TaskResult] = []
    for result in results:
        task = left.pop(result.task)
        done += task.picture_count if rendered else 1
        if result.outcome != "done":
            failures.append(result)
        else:
            found = _gathered(found)
        tell()
    if failures:
        first = failures[0]
        why = first.message or "another process is at it"
        raise StoreError(
            f"{found.folder}: {len(failures)} of {len(tasks)} stimuli could not be made "
            f"({first.task}: {why}); the same command goes on from there"
        )
    return found

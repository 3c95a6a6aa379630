"""Making a study's stimuli: what is missing, in parallel, from where it stopped."""

import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

from filelock import FileLock, Timeout
from pydantic import ValidationError

from pourcast.cores import available_cores
from pourcast.errors import InputError, StoreError
from pourcast.files import finished_files
from pourcast.progress import Report, no_report
from pourcast.scenes.liquids.base import Liquid
from pourcast.stimuli.manifest import (
    Manifest,
    Stimulus,
    StimulusRequest,
    StimulusSet,
    read_set,
    set_folder,
    write_set,
)
from pourcast.stimuli.renderers.preview import Preview
from pourcast.stimuli.settings import StimulusSettings
from pourcast.stimuli.solvers.sph import ParticleEngine
from pourcast.stimuli.task import MADE, WORK, StimulusTask
from pourcast.sweep.executors import Executor
from pourcast.sweep.executors.in_process import InProcessExecutor
from pourcast.sweep.executors.local import LocalExecutor
from pourcast.sweep.task import TaskResult

QUICK = StimulusSettings(solver=ParticleEngine(), renderer=Preview())
"""There in no time: what an experiment shows if nothing better was made."""

_WORTH_PROCESSES = 3
"""So many films pay for the start of other processes."""


def make_stimuli(
    study: Path,
    requests: Sequence[StimulusRequest],
    settings: StimulusSettings,
    *,
    replace: bool = False,
    workers: int | None = None,
    open_executor: Callable[[], Executor] | None = None,
    report: Report = no_report,
) -> StimulusSet:
    """Make those stimuli that are not there yet.

    Parameters
    ----------
    study
        The study folder.
    requests
        What is to be shown.
    settings
        How stimuli are made; their name is the set's.
    replace
        Whether to begin a set anew, with what is asked for now, that was made with other settings,
        liquids or code, or is damaged. What was in it goes.
    workers
        Stimuli at a time; the others' cores are shared. All cores by default; one for a slow
        renderer, which uses all of them by itself.
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
        If the set was made with other settings, or what is missing would be by other code; a
        liquid's numbers were others, two liquids have one name, or the renderer's program isn't
        there.
    StoreError
        If some stimuli could not be made; the others are. Also if another process makes this
        set: of two at once, with other settings, each would list what the other made.
    """
    folder = set_folder(study, settings.name)
    with _alone_at(folder):
        liquids = _liquids_of(requests)
        stimuli = _opened(folder, settings, liquids, replace)
        needed: dict[str, StimulusRequest] = {}
        for one in requests:  # groups that see the same are shown the same files
            if one.film or one.id not in needed:
                needed[one.id] = one
        missing = [one for one in needed.values() if not stimuli.has(one)]
        if (missing or replace) and stimuli.manifest.solver_code != settings.solver_code:
            if stimuli.manifest.stimuli and not replace:
                raise InputError(
                    f"{folder}: made with another version of the solver {settings.solver.name!r}, "
                    "whose films end elsewhere; what is missing can't be made alike. `pourcast "
                    "stimuli` with --replace begins it anew"
                )
            stimuli = _begun(folder, settings, liquids)
            missing = list(needed.values())
        if not missing:
            return stimuli
        settings.renderer.check_available()
        slow = settings.renderer.slow
        count = workers or (1 if slow else available_cores())
        threads = max(1, available_cores() // count) if open_executor is None else None
        tasks = [StimulusTask(folder.absolute(), one, settings, threads) for one in missing]
        films = sum(one.film for one in missing)
        if open_executor is None and not slow and films < _WORTH_PROCESSES:
            return _driven(stimuli, tasks, None, report)
        with closing(open_executor() if open_executor else LocalExecutor(count)) as executor:
            return _driven(stimuli, tasks, executor, report)


@contextmanager
def _alone_at(folder: Path) -> Iterator[None]:
    """Keep other processes from a set, and raise if one is at it."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    lock = FileLock(folder.parent / f".{folder.name}.lock")
    try:
        lock.acquire(blocking=False)
    except Timeout:
        raise StoreError(
            f"{folder}: another process is making these stimuli; wait for it, or stop it"
        ) from None
    try:
        yield
    finally:
        lock.release()


def _liquids_of(requests: Sequence[StimulusRequest]) -> list[Liquid]:
    """The liquids that are to be shown."""
    liquids: dict[str, Liquid] = {}
    for one in requests:
        if liquids.setdefault(one.liquid.name, one.liquid) != one.liquid:
            raise InputError(f"liquid {one.liquid.name!r}: two liquids of one name")
    return list(liquids.values())


def _opened(
    folder: Path, settings: StimulusSettings, liquids: Sequence[Liquid], replace: bool
) -> StimulusSet:
    """The set as far as it is there, with the liquids in its list."""
    try:
        there = read_set(folder)
        if there is not None:
            there.check_made_alike(settings, liquids)
    except InputError:
        if not replace:
            raise
        there = None
    if there is None:
        return _begun(folder, settings, liquids)
    stimuli = StimulusSet(folder, there.manifest.with_liquids(liquids))
    if stimuli != there:
        write_set(stimuli)
    return _gathered(stimuli)


def _begun(folder: Path, settings: StimulusSettings, liquids: Sequence[Liquid]) -> StimulusSet:
    """An empty set with the liquids in its list; what stood there goes."""
    _forget(folder)
    manifest = Manifest(settings=settings, solver_code=settings.solver_code)
    stimuli = StimulusSet(folder, manifest.with_liquids(liquids))
    write_set(stimuli)
    return stimuli


def _forget(folder: Path) -> None:
    """Remove what was made, or left unfinished, with other settings or code."""
    for path in folder.glob("*"):
        if path.name == WORK:
            shutil.rmtree(path)
        elif path.suffix in MADE:
            path.unlink()


def _gathered(stimuli: StimulusSet) -> StimulusSet:
    """Put finished stimuli into the list that a worker left beside it."""
    there = {(one.scene, one.liquid): one for one in stimuli.manifest.stimuli}
    entries = finished_files(stimuli.folder / WORK, "*.json")
    if not entries:
        return stimuli
    for path in entries:
        try:
            stimulus = Stimulus.model_validate_json(path.read_bytes())
        except ValidationError:
            continue  # of another version; it will be made again
        there[stimulus.scene, stimulus.liquid] = stimulus
    manifest = stimuli.manifest.model_copy(update={"stimuli": tuple(there.values())})
    gathered = StimulusSet(stimuli.folder, manifest)
    write_set(gathered)
    for path in entries:
        path.unlink()
    return gathered


class _Progress:
    """Counts pictures: those that a slow renderer has made, else those that are poured."""

    def __init__(self, tasks: Sequence[StimulusTask], slow: bool, report: Report) -> None:
        self._tasks = {task.id: task for task in tasks}
        self._slow, self._report = slow, report
        self._total = sum(task.picture_count for task in tasks)
        self._under_way = 0

    def tell(self) -> None:
        tasks = self._tasks.values()
        if self._slow:
            left = sum(task.picture_count - task.pictures_done for task in tasks)
            self._report("rendering pictures", self._total - left, self._total)
            return
        left = sum(task.picture_count for task in tasks)
        self._report(
            "pouring pictures", self._total - left + min(left, self._under_way), self._total
        )

    def heartbeat(self, poured: int, _seconds: float) -> None:
        self._under_way += poured
        self.tell()

    def done(self, name: str) -> None:
        self._under_way = max(0, self._under_way - self._tasks.pop(name).picture_count)


def _driven(
    stimuli: StimulusSet, tasks: list[StimulusTask], executor: Executor | None, report: Report
) -> StimulusSet:
    """Do tasks, and list each stimulus as soon as it is there."""
    slow = stimuli.manifest.settings.renderer.slow
    progress = _Progress(tasks, slow, report)
    progress.tell()
    results = (executor or InProcessExecutor()).run(tasks, progress.heartbeat)
    failures: list[TaskResult] = []
    for result in results:
        progress.done(result.task)
        if result.outcome != "done":
            failures.append(result)
        else:
            stimuli = _gathered(stimuli)
        progress.tell()
    if failures:
        first = failures[0]
        why = first.message or "another process is at it"
        raise StoreError(
            f"{stimuli.folder}: {len(failures)} of {len(tasks)} stimuli could not be made "
            f"({first.task}: {why}); the same command goes on from there"
        )
    return stimuli

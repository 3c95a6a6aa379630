"""Films of a study's scenes, as its design shows them."""

from collections.abc import Callable, Sequence
from pathlib import Path

from pourcast.experiment.design.plan import Shown, all_shown
from pourcast.progress import Report, no_report
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import resolve_liquid
from pourcast.scenes.scene import Scene
from pourcast.stimuli.contact_sheet import write_contact_sheet
from pourcast.stimuli.make import make_stimuli
from pourcast.stimuli.manifest import StimulusRequest, StimulusSet
from pourcast.stimuli.settings import StimulusSettings
from pourcast.study.folder import load_practice, pick_scene, study_liquids, study_scenes
from pourcast.sweep.executors import Executor


def film_study(
    study: Path,
    settings: StimulusSettings,
    *,
    first: int | None = None,
    names: Sequence[str] = (),
    liquid: str | None = None,
    replace: bool = False,
    workers: int | None = None,
    open_executor: Callable[[], Executor] | None = None,
    report: Report = no_report,
) -> tuple[StimulusSet, Path]:
    """Film a study's scenes, and make a contact sheet.

    Parameters
    ----------
    study
        The study folder.
    settings
        How stimuli are made.
    first
        Only the first so many scenes, without those for practice; all by default.
    names
        Only these scenes, by number or id.
    liquid
        Only this liquid; by default those of the design. A liquid that the design doesn't show
        is filmed with all the scenes.
    replace, workers, open_executor, report
        See `make_stimuli`.

    Returns
    -------
    StimulusSet
        All stimuli of the set.
    Path
        The contact sheet.

    Raises
    ------
    InputError, StoreError
        See `make_stimuli`; `InputError` also if there is no such scene or liquid.
    """
    scenes, practice = study_scenes(study), load_practice(study)
    chosen = scenes[:first] if first else [*scenes, *practice]
    if names:
        chosen = [pick_scene([*scenes, *practice], name, study) for name in names]
    stimuli = make_stimuli(
        study,
        _requests(all_shown(study), chosen, liquid, study_liquids(study)),
        settings,
        replace=replace,
        workers=workers,
        open_executor=open_executor,
        report=report,
    )
    return stimuli, write_contact_sheet(stimuli, [*scenes, *practice])


def _requests(
    shown: Sequence[Shown], chosen: Sequence[Scene], liquid: str | None, own: Sequence[Liquid]
) -> list[StimulusRequest]:
    """Films of those scenes that were chosen, with all liquids or one."""
    ids = {scene.id for scene in chosen}
    designed = [
        StimulusRequest(one.seen, resolve_liquid(one.liquid, one.scene, own), film=True)
        for one in shown
        if one.scene.id in ids
    ]
    if liquid is None:
        return designed
    only = [
        StimulusRequest(scene, resolve_liquid(liquid, scene, own), film=True) for scene in chosen
    ]
    liquids = [one.liquid for one in only]
    return [one for one in designed if one.liquid in liquids] or only

"""Judgments of many models on a study's scenes, found by model and parameters."""

import json
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pourcast.errors import InputError, StoreError
from pourcast.files import finished_files
from pourcast.models.registry import MODELS, family_of, make_model, name_of, parse_spec
from pourcast.progress import Report
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import resolve_liquid
from pourcast.scenes.scene import Scene
from pourcast.study.folder import study_liquids
from pourcast.sweep.executors.choose import ClusterOptions, make_executor
from pourcast.sweep.grid import Grid, GridFile, GridModels, make_grid
from pourcast.sweep.plan import make_plan
from pourcast.sweep.run import SweepReport, SweepResult, no_sweep_report, run_sweep
from pourcast.sweep.settings import ENGINE
from pourcast.sweep.store import Store
from pourcast.sweep.table import LIQUIDS
from pourcast.tables import (
    TABLE_SUFFIXES,
    numbers_in,
    read_table,
    refuse_rows,
    require_columns,
)

Array = NDArray[np.float64]

LiquidAndModel = tuple[str, str]
"""Liquid of the trials, and spec of a model."""

SMALL_WORK = 3.0
"""Work that is done without other processes [s of one core]; they take over a second to start."""

TEXT_COLUMNS = ("scene", "digest", "liquid", "model", "parameters")

COLUMNS = ["digest", "liquid", "model", "parameters", "seed", "judgment"]

OWN_ALPHA = "own"
"""What stands for the liquid's own viscosity among values of `viscosity_alpha`."""


@dataclass(frozen=True)
class Judgments:
    """Judgments of models, one row a model, its parameters and the liquid of the trials.

    Parameters
    ----------
    scenes
        The study's scenes.
    rows
        `liquid`, `family`, `parameters` (JSON), and a column for each parameter, as numbers;
        `imagined` for the liquid in the model's head.
    judgments
        Shape [row_count, scene_count]; NaN where none is known.
    own
        The study's own liquids.
    engines
        Names of the tables that were not computed with engine settings as they come, and what of
        the settings was otherwise.
    """

    scenes: tuple[Scene, ...]
    rows: pd.DataFrame
    judgments: Array
    own: tuple[Liquid, ...] = ()
    engines: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def find(self, liquid: str, spec: str) -> Array | None:
        """A model's judgments on all scenes; None if they are not all known.

        Parameters
        ----------
        liquid
            Liquid of the trials, by the name that the judgments' tables have.
        spec
            The model.
        """
        row = self.row(liquid, spec)
        return None if row is None or np.isnan(row).any() else row

    def row(self, liquid: str, spec: str) -> Array | None:
        """A model's judgments as far as they are known, NaN elsewhere; None if none is."""
        wanted = json.dumps(make_model(spec, self.own).parameters())
        same = (self.rows["liquid"] == liquid) & (self.rows["parameters"] == wanted)
        matches = np.flatnonzero(same & (self.rows["family"] == family_of(name_of(spec))))
        return self.judgments[matches[0]] if len(matches) else None

    def on(self, scenes: Sequence[Scene]) -> "Judgments":
        """Only the judgments of some scenes."""
        index = {scene.id: k for k, scene in enumerate(self.scenes)}
        chosen = [index[scene.id] for scene in scenes]
        return replace(self, scenes=tuple(scenes), judgments=self.judgments[:, chosen])

    def on_trials(self, liquid: str, **values: Any) -> NDArray[np.int64]:
        """Rows of models that judge trials with a liquid, with these values; see `where`.

        If there are none, those under any other liquid, each model once; but only of models to
        which it makes no difference what the trial shows.
        """
        rows = self.where(liquid=liquid, **values)
        if len(rows):
            return rows
        others = self.rows.iloc[self.where(**values)]
        alike = [
            not _follows_trial(family, json.loads(parameters))
            for family, parameters in zip(others["family"], others["parameters"], strict=True)
        ]
        others = others[np.array(alike, dtype=np.bool_)]
        return others.index[~others.duplicated(["family", "parameters"])].to_numpy(np.int64)

    def where(self, **values: Any) -> NDArray[np.int64]:
        """Rows with these values in these columns, whose judgments are all known."""
        same = ~np.isnan(self.judgments).any(axis=1)
        for column, value in values.items():
            if column not in self.rows:
                return np.empty(0, np.int64)
            same &= (self.rows[column] == value).to_numpy()
        return np.flatnonzero(same)


def _follows_trial(family: str, parameters: Mapping[str, Any]) -> bool:
    """Whether a model's judgments depend on the trial's liquid; yes if it isn't known here."""
    try:
        return MODELS.get(family).follows_trial(parameters)
    except InputError:
        return True


def judgments_of(
    tables: Iterable[pd.DataFrame], scenes: Sequence[Scene], own: tuple[Liquid, ...] = ()
) -> Judgments:
    """Put tables of judgments together; the first seed of each model counts.

    Parameters
    ----------
    tables
        As `prediction.predict` or a sweep gives.
    scenes
        The study's scenes; judgments of any others are left out.
    """
    parts = [table[COLUMNS] for table in tables]
    index = {scene.digest: k for k, scene in enumerate(scenes)}
    empty = pd.DataFrame(columns=["liquid", "family", "parameters", "imagined"])
    if not parts:
        return Judgments(tuple(scenes), empty, np.empty((0, len(scenes))), own)
    table = pd.concat(parts, ignore_index=True)
    table = table[table["digest"].isin(index)].sort_values("seed", kind="stable")
    names = {name: family_of(name) for name in table["model"].unique()}
    table["family"] = table["model"].map(names)
    keys = ["liquid", "family", "parameters"]
    table = table.drop_duplicates(["digest", *keys])
    grouped = table.groupby(keys, sort=False)
    number = grouped.ngroup().to_numpy()
    rows = table[~table.duplicated(keys)][keys].reset_index(drop=True)
    judgments = np.full((len(rows), len(scenes)), np.nan)
    judgments[number, table["digest"].map(index).to_numpy(int)] = table["judgment"]
    parameters = pd.DataFrame([columns_of(json.loads(text)) for text in rows["parameters"]])
    same = {scene.digest: k for k, scene in enumerate(scenes)}
    twins = [same[scene.digest] for scene in scenes]
    labelled = pd.concat([rows, parameters], axis=1)
    return Judgments(tuple(scenes), labelled, judgments[:, twins], own)


def columns_of(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """A model's parameters by the names and values that they have in `Judgments.rows`."""
    taken = ("liquid", "family", "parameters", "imagined")
    named = {f"model_{name}" if name in taken else name: v for name, v in parameters.items()}
    if "liquid" in parameters:
        named["imagined"] = named.pop("model_liquid")
    if named.get("viscosity_alpha", 0.0) is None:
        named["viscosity_alpha"] = OWN_ALPHA
    return named


def study_judgments(study: Path, scenes: Sequence[Scene]) -> Judgments:
    """All judgments in a study's tables; tables with gaps are left alone.

    Raises
    ------
    InputError
        If a table can't be read (names file, row and column of what is wrong), or was made when
        one of the study's own liquids was another.
    """
    own = study_liquids(study)
    tables = {
        path: read_judgments(path)
        for path in finished_files(study / "judgments")
        if path.suffix in TABLE_SUFFIXES and not path.stem.endswith("-incomplete")
    }
    for path, table in tables.items():
        _refuse_changed_liquids(path, table, own)
    _refuse_other_engines(tables)
    engines = {path.stem: table.attrs.get(ENGINE) for path, table in tables.items()}
    changed = {name: settings for name, settings in engines.items() if settings}
    return replace(judgments_of(tables.values(), scenes, own), engines=changed)


def _refuse_other_engines(tables: Mapping[Path, pd.DataFrame]) -> None:
    """Judgments of one model that were computed with other settings can't stand for one another."""
    engines = {path: json.dumps(table.attrs.get(ENGINE) or {}) for path, table in tables.items()}
    if len(set(engines.values())) < 2:
        return
    rows = pd.concat(
        [
            table[COLUMNS].assign(path=str(path), engine=engines[path])
            for path, table in tables.items()
        ],
        ignore_index=True,
    )
    rows["family"] = rows["model"].map({name: family_of(name) for name in rows["model"].unique()})
    groups = rows.groupby(["digest", "liquid", "family", "parameters"], sort=False)
    many = groups[["judgment", "engine"]].transform("nunique").gt(1).all(axis=1)
    if many.any():
        first = rows[many & (groups.ngroup() == groups.ngroup()[many].iloc[0])]
        paths = sorted(first.drop_duplicates("engine")["path"])
        raise InputError(
            f"{paths[0]}: judges {first['model'].iloc[0]} with other engine settings than "
            f"{paths[1]}: keep one of them in the study, or each in a study of its own"
        )


def _refuse_changed_liquids(path: Path, table: pd.DataFrame, own: Sequence[Liquid]) -> None:
    now = {liquid.name: liquid.engine_identity for liquid in own}
    for name, then in table.attrs.get(LIQUIDS, {}).items():
        if now.get(name) != then:
            raise InputError(
                f"{path}: liquid {name!r} was another when this was judged; sweep "
                f"{path.stem!r} again, or remove the table"
            )


def read_judgments(path: Path) -> pd.DataFrame:
    """Read a table of judgments, as `prediction.predict` or a sweep makes it, and check it.

    Raises
    ------
    InputError
        One line that names the row, the column and what was expected.
    """
    table = read_table(path, text=TEXT_COLUMNS)
    require_columns(path, table, COLUMNS)
    for column in TEXT_COLUMNS[1:]:
        refuse_rows(path, table, column, table[column].isna(), "expected text")
    broken = [text for text in table["parameters"].unique() if not _is_json_object(text)]
    wrong = table["parameters"].isin(broken)
    refuse_rows(path, table, "parameters", wrong, "expected a JSON object")
    table["seed"] = numbers_in(path, table, "seed", table["seed"].isna())
    table["judgment"] = numbers_in(path, table, "judgment")
    outside = ~table["judgment"].between(0.0, 1.0) & table["judgment"].notna()
    refuse_rows(path, table, "judgment", outside, "expected 0..1")
    return table


def _is_json_object(text: str) -> bool:
    try:
        return isinstance(json.loads(text), dict)
    except ValueError:
        return False


def judge_in_study(
    study: Path,
    scenes: Sequence[Scene],
    requests: Sequence[LiquidAndModel],
    name: str,
    *,
    workers: int | None = None,
    report: SweepReport = no_sweep_report,
) -> dict[LiquidAndModel, Array]:
    """Judgments of models; simulations go through the study's store, and none is done twice.

    Parameters
    ----------
    study
        The study folder.
    scenes
        Its scenes.
    requests
        Liquids of trials and specs of models.
    name
        Name of the grid that the store keeps of it.
    workers
        Processes; all cores by default.
    report
        Told of the progress.

    Raises
    ------
    InputError
        If a spec is wrong.
    StoreError
        If some judgments could not be made.
    """
    if not requests:
        return {}
    own = study_liquids(study)
    grid = grid_of(requests, scenes[0], name, own)
    result = sweep_in_study(study, scenes, grid, workers=workers, report=report)
    if result.failures:
        raise StoreError(f"{study}: {result.failures[0].message}")
    judged = judgments_of([result.table], scenes, own)
    kinds = {scene.goal.kind: scene for scene in scenes}.values()
    answers: dict[LiquidAndModel, Array] = {}
    for liquid, spec in requests:
        answer = np.full(len(scenes), np.nan)
        for name_there in {resolve_liquid(liquid, scene, own).name for scene in kinds}:
            row = judged.row(name_there, spec)
            answer = answer if row is None else np.where(np.isnan(row), answer, row)
        if np.isnan(answer).any():
            scene = scenes[int(np.flatnonzero(np.isnan(answer))[0])].id
            raise StoreError(f"{study}: no judgment of scene {scene!r} by {spec} ({liquid})")
        answers[liquid, spec] = answer
    return answers


def sweep_in_study(
    study: Path,
    scenes: Sequence[Scene],
    grid: Grid,
    *,
    workers: int | None = None,
    report: SweepReport = no_sweep_report,
) -> SweepResult:
    """Run a grid over a study's scenes here; see `judge_in_study` and `sweep.run.run_sweep`.

    Small work is done in this process: others take longer to start.
    """
    with _store_of(study) as store:
        opened = partial(make_executor, "local", workers, store.folder, None, ClusterOptions())
        return run_sweep(
            make_plan(grid, scenes), store, opened, in_process_below=SMALL_WORK, report=report
        )


@contextmanager
def _store_of(study: Path) -> Iterator[Store]:
    """A study's store; of a study that can't be written, one for now that knows what is in it."""
    folder = study / "sweep"
    if os.access(folder if folder.exists() else study, os.W_OK):
        yield Store(folder)
        return
    with TemporaryDirectory() as place:
        if folder.exists():
            shutil.copytree(folder, Path(place, "sweep"), copy_function=_link)
            for one in Path(place).rglob("*/"):
                one.chmod(0o700)
        yield Store(Path(place, "sweep"))


def _link(there: str, here: str) -> None:
    os.symlink(Path(there).absolute(), here)


def grid_of(
    requests: Sequence[LiquidAndModel], scene: Scene, name: str, own: Sequence[Liquid] = ()
) -> Grid:
    """A grid that asks for some models.

    Parameters
    ----------
    requests
        Liquids of trials and specs of models.
    scene
        One of the scenes that are to be judged.
    name
        Name of the grid.
    own
        The study's own liquids.
    """
    entries = []
    for liquid, spec in requests:
        make_model(spec, own)
        resolve_liquid(liquid, scene, own)
        model, values = parse_spec(spec)
        entries.append(GridModels(model=model, liquids=(liquid,), parameters=dict(values)))
    return make_grid(name, GridFile(models=tuple(entries)), own)


def sweep_words(report: Report, what: str) -> SweepReport:
    """Tell of a sweep as of any other work."""
    return lambda now: report(what, now.simulations, now.all_simulations)

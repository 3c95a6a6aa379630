"""What a point gives: scenes drawn and filtered at it, all models on them, through a store.

    FOLDER/point.toml       the point
    FOLDER/scenes.json      its scenes
    FOLDER/drawn.json       how they were drawn, and their digest
    FOLDER/sweep/           the store of its pours
    FOLDER/measured.json    judgments of each model on each scene: done means that it is there

Whatever is there is not done again, so that it can be interrupted at any moment.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from benchmarks.calibration.space import HONEY_NAME, WATER_NAME, Point, World, point_text, world
from benchmarks.calibration.targets import MODELS, VARIANCES, Target
from pourcast.errors import InputError, SimulationDivergedError
from pourcast.files import write_text
from pourcast.models.base import zeta_window
from pourcast.models.registry import make_model, presets
from pourcast.progress import Report, no_report
from pourcast.scenes.scene import Scene
from pourcast.scenes.scene_file import read_scenes, write_scenes
from pourcast.simulation.run import engine_version
from pourcast.simulation.versions import code_version
from pourcast.study.selection import filtered_scenes
from pourcast.sweep.executors.in_process import InProcessExecutor
from pourcast.sweep.executors.local import LocalExecutor
from pourcast.sweep.grid import Grid, GridFile, GridModels, make_grid
from pourcast.sweep.plan import Plan, make_plan
from pourcast.sweep.run import run_sweep
from pourcast.sweep.store import Store
from pourcast.sweep.table import setting_judgments
from pourcast.sweep.task import OnWork, TaskResult, no_work, told

Array = NDArray[np.float64]

SHARD_SECONDS = 20.0
"""Work that is lost at most when a worker is killed [s of one core]."""

LEAST_SCENES = 5
"""Of a point: Fisher's z of n scenes has the variance 1 / (n - 3)."""

WINDOW = 9
"""Values of zeta in the window of an IFE."""

FLIP = 0.5
"""A scene flips if its judgments range over more than this in the window."""

DONE = "measured.json"

EVERY_ZETA = 1
SECOND_ZETA = 2
"""Of a window: in waves each second zeta is poured, from end to end."""

LIQUID_OF = {
    "truth-water": WATER_NAME,
    "truth-honey": HONEY_NAME,
    "water-ife": WATER_NAME,
    "honey-ife-1": HONEY_NAME,
    "honey-ife-2": WATER_NAME,
}
"""What flows in the model's head."""


@dataclass(frozen=True)
class Measured:
    """What a point gave.

    Parameters
    ----------
    point
        The point.
    judgments
        Model -> its judgment of each scene.
    windows
        IFE -> judgments at each zeta of its window, shape [zeta_count, scene_count].
    stranded
        Truth -> mean share of the liquid that stays on obstacles.
    drawn, kept
        Scenes drawn, and how many of these passed the filter.
    obstacles
        Their mean number in a scene.
    failure
        What went wrong; then there is nothing else.
    """

    point: dict[str, Any]
    judgments: dict[str, list[float]] = field(default_factory=dict)
    windows: dict[str, list[list[float]]] = field(default_factory=dict)
    stranded: dict[str, float] = field(default_factory=dict)
    drawn: int = 0
    kept: int = 0
    obstacles: float = 0.0
    failure: str = ""

    @property
    def scenes(self) -> int:
        """How many scenes it was measured on."""
        return len(next(iter(self.judgments.values()), []))

    def correlation(self, first: str, second: str) -> float:
        """Pearson r of two models over the scenes; NaN if one of them never varies."""
        a, b = np.array(self.judgments[first]), np.array(self.judgments[second])
        if a.std() == 0.0 or b.std() == 0.0:
            return np.nan
        return float(np.corrcoef(a, b)[0, 1])

    def scene_variances(self, ife: str) -> Array:
        """Variance over the window of zeta in each scene, as of nine values.

        Of each second value it is estimated without Bessel's correction: a trend then gives 7 %
        more than all nine with it do, a step in the middle 14 % less.
        """
        window = np.array(self.windows[ife])
        variances: Array = window.var(axis=0, ddof=1 if len(window) == WINDOW else 0)
        return variances

    def flips(self, ife: str) -> float:
        """Share of scenes whose judgment flips over the window."""
        return float(np.mean(np.ptp(np.array(self.windows[ife]), axis=0) > FLIP))


LEAST_VARIANCE = 1e-5
"""Added to variances before their logarithm is taken: a particle of fifty that changes sides once
in a window of nine makes 4e-5 in its scene."""


def log_variance(per_scene: Array) -> tuple[float, float]:
    """Logarithm of a mean over scenes, and the variance that sampling gives it for one scene.

    To first order (the delta method), which is the jackknife's to first order too; the bias of
    the logarithm, half its variance, is taken out.
    """
    mean = float(per_scene.mean()) + LEAST_VARIANCE
    of_one = float(per_scene.var(ddof=1)) / mean**2
    return float(np.log(mean)) + 0.5 * of_one / len(per_scene), of_one


def output(measured: Measured, target: Target, one_scene: float) -> tuple[float, float]:
    """A point's value of an output, and the variance of its sampling; NaN if it has none.

    Parameters
    ----------
    measured
        The point.
    target
        The output.
    one_scene
        For variances: sampling variance of the logarithm for one scene, pooled over all points
        (a point's own is small just where it happened to draw no scene that flips).
    """
    n = measured.scenes
    if target.kind in ("correlation", "bound"):
        first, second = target.name.split(" / ")
        r = np.clip(measured.correlation(first, second), -0.999, 0.999)
        return float(np.arctanh(r)), 1.0 / (n - 3)
    if target.kind == "variance":
        return log_variance(measured.scene_variances(target.name))[0], one_scene / n
    return measured.stranded[target.name], 0.05**2 / n


def parameters_of(preset: str) -> dict[str, Any]:
    """Parameters of a preset."""
    return dict(presets()[preset]["parameters"])


def dampings_of(preset: str, stride: int) -> list[float]:
    """Values of zeta of a model's window, every one or each second, or none if it has no zeta."""
    given = parameters_of(preset)
    if "damping_zeta" not in given:
        return []
    window = zeta_window(given["damping_zeta"], given["zeta_sigma"])
    return window[::stride]


def grid_of_world(here: World, stride: int = EVERY_ZETA) -> Grid:
    """All models on a point's scenes, those that pour one zeta at a time."""
    entries = []
    for name in MODELS:
        family, given = presets()[name]["model"], parameters_of(name)
        values = {key: v for key, v in given.items() if key != "liquid"}
        if dampings := dampings_of(name, stride):
            values |= {"damping_zeta": dampings, "zeta_sigma": 0}
        liquid = LIQUID_OF.get(name, WATER_NAME)
        entries.append(GridModels(model=family, liquids=(liquid,), parameters=values))
    content = GridFile(models=tuple(entries), shard_seconds=SHARD_SECONDS)
    return make_grid("point", content, (here.water, here.honey))


def measure(
    point: Point, scenes: int, seed: int, folder: Path, stride: int = EVERY_ZETA
) -> Measured:
    """Measure a point; what its folder has already is not done again.

    Parameters
    ----------
    point
        The point.
    scenes
        How many scenes are drawn and filtered.
    seed
        Of the scenes.
    folder
        Where results are kept.
    stride
        `EVERY_ZETA` of each window, or each `SECOND_ZETA`.

    Raises
    ------
    InputError
        If the folder holds another point, or what another state of the engine gave.
    """
    here = world(point)
    key = key_of(here, scenes, seed, stride) | {"point": dict(point)}
    done = folder / DONE
    if done.exists():
        content = read_json(done)
        different = [name for name in key if content.get("key", {}).get(name) != key[name]]
        if different:
            raise InputError(f"{done}: other {', '.join(different)}: take another --store")
        try:
            found = Measured(**content["measured"])
        except (KeyError, TypeError):
            raise InputError(f"{done}: measured: expected what a point gave") from None
        if not found.failure:
            _scenes(here, scenes, seed, folder)  # lest others have been put in place since
        return found
    write_text(folder / "point.toml", point_text(point))
    try:
        found = _measure(here, dict(point), (scenes, seed, stride), folder)
    except (InputError, SimulationDivergedError) as error:
        found = Measured(dict(point), failure=str(error))
    write_text(done, json.dumps({"key": key, "measured": vars(found)}) + "\n")
    return found


def read_json(path: Path) -> dict[str, Any]:
    """Read a file of the store.

    Raises
    ------
    InputError
        If it can't be read, or holds something else.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except ValueError as error:
        raise InputError(f"{path}: not a JSON file ({error})") from None
    if not isinstance(content, dict):
        raise InputError(f"{path}: expected an object, found {type(content).__name__}")
    return content


def key_of(here: World, scenes: int, seed: int, stride: int) -> dict[str, Any]:
    """All that decides what a point gives: what the world is, numbers and code alike."""
    return scenes_key(here, scenes, seed) | {
        "stride": stride,
        "liquids": [here.water.engine_identity, here.honey.engine_identity],
        "models": {name: [presets()[name]["model"], parameters_of(name)] for name in MODELS},
        "models' code": code_version(sources_of_key(), ("pourcast.simulation.versions",)),
    }


def sources_of_key() -> tuple[str, ...]:
    """Modules that define the models; their imports count with them."""
    return tuple(sorted({type(make_model(name)).__module__ for name in MODELS}))


def is_current(key: Mapping[str, Any], point: Point) -> bool:
    """Whether a key of the store is what the same errand would have today."""
    asked = {name: key.get(name, 0) for name in ("scenes", "seed", "stride")}
    return key == key_of(world(point), **asked) | {"point": dict(point)}


def scenes_key(here: World, scenes: int, seed: int) -> dict[str, Any]:
    """All that decides which scenes are drawn, and which of these pass."""
    rule = {name: value for name, value in vars(here.rule).items() if name != "settings"}
    return {
        "scenes": scenes,
        "seed": seed,
        "engine settings": asdict(here.engine),
        "family": asdict(here.family),
        "filter": rule | {"liquid": here.water.engine_identity},
        "scenes' code": code_version(
            (type(here.family).__module__, type(here.rule).__module__),
            ("pourcast.simulation.versions", "pourcast.networks"),
        ),
        "engine": engine_version(),
    }


def _measure(
    here: World, point: dict[str, Any], asked: tuple[int, int, int], folder: Path
) -> Measured:
    count, seed, stride = asked
    scenes, drawn, kept = _scenes(here, count, seed, folder)
    grid, store = grid_of_world(here, stride), Store(folder / "sweep")
    plan = make_plan(grid, scenes, here.engine)
    result = run_sweep(plan, store, InProcessExecutor, attempts=1)
    if result.failures:
        return Measured(point, failure=result.failures[0].message)
    files = list(store.paths().values())
    values, stranded = setting_judgments(plan, store, files), _stranded(plan, store, files)
    # Answers come in the order of the grid, one for each zeta of a window.
    answers = iter(plan.answers)
    judgments, windows, stays = {}, {}, {}
    for name in MODELS:
        several = len(dampings_of(name, stride)) or 1
        numbers = [list(next(answers).settings) for _ in range(several)]
        window = np.array([values[few].mean(axis=0) for few in numbers])
        judgments[name] = window.mean(axis=0).tolist()
        if name in VARIANCES:
            windows[name] = window.tolist()
        stays[name] = float(np.mean([stranded.get(k, 0.0) for few in numbers for k in few]))
    obstacles = float(np.mean([len(scene.obstacles) for scene in scenes]))
    return Measured(point, judgments, windows, stays, drawn, kept, obstacles)


def _scenes(here: World, count: int, seed: int, folder: Path) -> tuple[list[Scene], int, int]:
    """A point's scenes, how many were drawn for them, and how many of those passed.

    Other scenes than were drawn for this key, or by it before one of them changed, are not taken.
    """
    path, notes = folder / "scenes.json", folder / "drawn.json"
    key = scenes_key(here, count, seed)
    if path.exists() and notes.exists():
        note = read_json(notes)
        if note.get("key") == key and note.get("sha256") == _sha256(path):
            return read_scenes(path), int(note["drawn"]), int(note["kept"])
    chosen = filtered_scenes(here.family, count, seed, rule=here.rule)
    write_scenes(path, chosen.scenes)
    note = {"drawn": chosen.drawn, "kept": chosen.kept, "sha256": _sha256(path), "key": key}
    write_text(notes, json.dumps(note) + "\n")
    return read_scenes(path), chosen.drawn, chosen.kept


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _stranded(plan: Plan, store: Store, files: Sequence[Path]) -> dict[int, float]:
    """Setting -> mean share of the liquid that stays on obstacles, if it is poured."""
    number = {setting.identity: k for k, setting in enumerate(plan.settings)}
    tables = [table for path in files if (table := store.read(path)) is not None]
    rows = pa.concat_tables(tables).select(["setting", "stranded"]).to_pandas().dropna()
    means = rows.groupby("setting", observed=True)["stranded"].mean()
    return {number[str(identity)]: float(value) for identity, value in means.items()}


@dataclass(frozen=True)
class Errand:
    """A point that is to be measured: a task of an executor; see `measure`."""

    point: dict[str, Any]
    scenes: int
    seed: int
    folder: Path
    stride: int = EVERY_ZETA

    @property
    def id(self) -> str:
        """Its folder."""
        return str(self.folder)

    def run(self, on_work: OnWork = no_work) -> TaskResult:
        """Measure it; never raises an ordinary error."""
        try:
            self.measured()
        except Exception as error:
            return TaskResult(self.id, "failed", told(error))
        return TaskResult(self.id, "done")

    def measured(self) -> Measured:
        """What it gives, measured now or before."""
        return measure(self.point, self.scenes, self.seed, self.folder, self.stride)


def measure_all(
    errands: Sequence[Errand], workers: int, report: Report = no_report
) -> list[Measured]:
    """Measure points, each on a core of its own; results don't depend on how many there are.

    Parameters
    ----------
    errands
        The points.
    workers
        How many at a time.
    report
        Told of the progress.

    Raises
    ------
    InputError
        If one can't be measured at all; what was done before is kept.
    """
    left = [errand for errand in errands if not (errand.folder / DONE).exists()]
    done = len(errands) - len(left)
    report("points", done, len(errands))
    if left:
        with closing(LocalExecutor(workers)) as executor:
            for result in executor.run(left, no_work):
                if result.outcome != "done":
                    raise InputError(f"{result.task}: {result.message}")
                done += 1
                report("points", done, len(errands))
    return [errand.measured() for errand in errands]

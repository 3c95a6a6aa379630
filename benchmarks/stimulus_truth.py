"""How far the stimuli's solver and the particle engine's ground truths agree.

    python -m benchmarks.stimulus_truth FOLDER [--experiment exp1] [--scenes 40] [--seed 1]
        [--cells 40 60 100 150] [--viscosity 0.02] [--liquids water] [--layers 3]
        [--moved 1 | --shifted 0.5]

makes a table of `docs/reference/stimulus-truth.md`: scenes of an experiment as it stands, each
poured by the lattice-Boltzmann solver at every resolution, as water and as honey, for the film's
length, and judged by the ground truths. `--viscosity` adds honey of other viscosities [m^2/s];
`--moved` pours all once more, from starts moved to the right [mm], to see how far chaos goes;
`--shifted` does so with all but the box moved by a share of a cell, to see how much it matters
where the lattice lies. `--layers` is the solver's: so many cells through the depth, which is
cheaper. FOLDER keeps each outcome as it comes: the same command goes on after an interruption,
and pours only what another scene, liquid or code makes new.
"""

import argparse
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.calibration.chaos import moved
from pourcast.cli.terminal import progress_bar, resumable
from pourcast.cores import available_cores
from pourcast.prediction import predict
from pourcast.progress import Report, no_report
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import resolve_liquid
from pourcast.scenes.scene import Scene
from pourcast.simulation.versions import code_version
from pourcast.stimuli.solvers.lbm import LatticeBoltzmann, pour_to_end
from pourcast.study.folder import SceneRequest, generate_scenes

Array = NDArray[np.float64]

RESOLUTIONS = (40, 60, 100, 150)
LIQUIDS = ("water", "honey")
TRUTHS = ("truth-water", "truth-honey")

Key = tuple[str, int]
"""A film's name, and cells along the longest side."""

Change = Callable[[Scene, float], Scene]
"""What is done to a scene, given the width of a cell [m], before it is poured on film."""


@dataclass(frozen=True)
class Film:
    """A pour to be made."""

    scene: Scene
    liquid: Liquid
    solver: LatticeBoltzmann

    @property
    def digest(self) -> str:
        """All that its outcome depends on, the solver's code included, in 12 digits."""
        content = [
            self.scene.digest,
            self.solver.model_dump(),
            self.solver.liquid_identity(self.liquid),
            self.liquid.film_seconds,
            code_version(("pourcast.stimuli.solvers.lbm",)),
        ]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:12]

    def outcome(self) -> tuple[float, float]:
        """Outcome and stranded share; see `pour_to_end`."""
        return pour_to_end(self.scene, self.liquid, self.solver, self.liquid.film_seconds)


def outcomes_in(folder: Path) -> dict[str, tuple[float, float]]:
    """What a folder keeps, by films' digests."""
    path = folder / "outcomes.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    # The last line may have been cut off by an interruption.
    whole = [json.loads(line) for line in lines if line.endswith("}")]
    return {row["film"]: (row["outcome"], row["stranded"]) for row in whole}


def pour_missing(films: Sequence[Film], folder: Path, report: Report = no_report) -> None:
    """Pour what the folder doesn't keep yet, the long films first, on all cores."""
    folder.mkdir(parents=True, exist_ok=True)
    known = outcomes_in(folder)
    missing = {film.digest: film for film in films if film.digest not in known}
    by_length = sorted(missing.items(), key=lambda item: -item[1].solver.resolution)
    with (
        ProcessPoolExecutor(available_cores()) as pool,
        (folder / "outcomes.jsonl").open("a", encoding="utf-8") as lines,
    ):
        work = {pool.submit(film.outcome): digest for digest, film in by_length}
        try:
            for done, future in enumerate(as_completed(work), start=1):
                outcome, stranded = future.result()
                row = {"film": work[future], "outcome": outcome, "stranded": stranded}
                # On a line of its own, even where the one before was cut off.
                lines.write(f"\n{json.dumps(row)}")
                lines.flush()
                report("pouring films", done, len(work))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def judged(scenes: Sequence[Scene]) -> dict[str, Array]:
    """The ground truths' judgments."""
    table = predict(scenes, list(TRUTHS))
    places = [scene.id for scene in scenes]
    return {
        name: rows.drop_duplicates("scene").set_index("scene")["judgment"][places].to_numpy()
        for name, rows in table.groupby("model")
    }


def r(one: Array, other: Array) -> str:
    return f"{np.corrcoef(one, other)[0, 1]:.2f}"


def rows(
    ends: Mapping[Key, Array], truths: Mapping[str, Array], resolutions: Sequence[int]
) -> list[list[str]]:
    """Rows of the table; `ends` has outcome and stranded share of each scene in its columns."""
    finest = resolutions[-1]
    head = ["film", "cells", *(f"r, {name}" for name in TRUTHS), "mean difference, own truth"]
    head += [f"r, {finest} cells", "r, water film", "mean (SD)", "stranded"]
    table = [head]
    for (name, cells), end in ends.items():
        own, stranded = end.T
        row = [name, str(cells), *(r(own, truths[truth]) for truth in TRUTHS)]
        row += [f"{np.abs(own - truths[f'truth-{name.split()[0]}']).mean():.2f}"]
        water = r(own, ends["water", cells][:, 0]) if ("water", cells) in ends else ""
        row += [r(own, ends[name, finest][:, 0]), water]
        row += [f"{own.mean():.2f} ({own.std():.2f})", f"{stranded.mean():.2f}"]
        table.append(row)
    for name in dict.fromkeys(name for name, _ in ends):
        mean = np.mean([ends[name, cells][:, 0] for cells in resolutions], axis=0)
        own = truths[f"truth-{name.split()[0]}"]
        row = [name, "mean of these", *(r(mean, truths[truth]) for truth in TRUTHS)]
        row += [f"{np.abs(mean - own).mean():.2f}", r(mean, ends[name, finest][:, 0]), ""]
        table.append([*row, f"{mean.mean():.2f} ({mean.std():.2f})", ""])
    return table


def shifted(scene: Scene, shift: float) -> Scene:
    """The scene, all but its box moved to the right by so many metres."""
    obstacles = tuple(tuple((x + shift, y) for x, y in polygon) for polygon in scene.obstacles)
    place = "divider_x" if scene.goal.kind == "basins" else "centre_x"
    goal = scene.goal.model_copy(update={place: getattr(scene.goal, place) + shift})
    return moved(scene, shift).model_copy(update={"obstacles": obstacles, "goal": goal})


def _same(scene: Scene, _cell: float) -> Scene:
    return scene


def cell_of(scene: Scene, cells: int) -> float:
    """Width of a cell [m]."""
    return max(scene.box.width, scene.box.height, scene.box.depth) / cells


def films_of(
    scenes: Sequence[Scene],
    resolutions: Sequence[int],
    viscosities: Sequence[float],
    liquids: Sequence[str] = LIQUIDS,
    change: Change = _same,
    layers: int | None = None,
) -> dict[Key, list[Film]]:
    """The films of each row: liquids, and honey of other viscosities [m^2/s]."""
    poured = {name: [resolve_liquid(name, scene) for scene in scenes] for name in liquids}
    for viscosity in viscosities:
        poured[f"honey of {viscosity:g} m²/s"] = [
            replace(resolve_liquid("honey", scene), kinematic_viscosity=viscosity)
            for scene in scenes
        ]
    return {
        (name, cells): [
            Film(change(scene, cell_of(scene, cells)), liquid, solver)
            for scene, liquid in zip(scenes, each, strict=True)
        ]
        for name, each in poured.items()
        for cells in resolutions
        for solver in [LatticeBoltzmann(resolution=cells, layers=layers)]
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="keeps outcomes")
    parser.add_argument("--experiment", default="exp1")
    parser.add_argument("-n", "--scenes", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cells", type=int, nargs="+", default=list(RESOLUTIONS))
    parser.add_argument("--viscosity", type=float, nargs="+", default=[], help="of more honeys")
    parser.add_argument("--liquids", nargs="+", default=list(LIQUIDS), choices=LIQUIDS)
    parser.add_argument("--layers", type=int, help="depth of the films' box [cells]")
    again = parser.add_mutually_exclusive_group()
    again.add_argument("--moved", type=float, help="of the starts, in a second pour of all [mm]")
    again.add_argument("--shifted", type=float, help="of all but the box, in another [cells]")
    chosen = parser.parse_args()
    request = SceneRequest(chosen.experiment, chosen.scenes, chosen.seed)
    scenes, cells = generate_scenes(request).scenes, sorted(chosen.cells)
    drawn: list[Sequence[Scene]] = [scenes]
    changes: list[Change] = [_same]
    if chosen.moved is not None:
        drawn += [[moved(scene, chosen.moved / 1000) for scene in scenes]]
        changes += [_same]
    if chosen.shifted is not None:
        drawn += [scenes]
        changes += [lambda scene, cell: shifted(scene, chosen.shifted * cell)]
    films = [
        films_of(each, cells, chosen.viscosity, chosen.liquids, change, chosen.layers)
        for each, change in zip(drawn, changes, strict=True)
    ]
    missing = [film for each in films for row in each.values() for film in row]
    with resumable(chosen.folder), progress_bar() as report:
        pour_missing(missing, chosen.folder, report)
    known = outcomes_in(chosen.folder)
    truths = [judged(each) for each in drawn]
    ends = [
        {key: np.array([known[film.digest] for film in row]) for key, row in each.items()}
        for each in films
    ]
    table = rows(ends[0], truths[0], cells)
    print(
        f"`pourcast scenes {chosen.experiment} -n {chosen.scenes} --seed {chosen.seed}`. The "
        f"truths among themselves: r {r(*truths[0].values())}."
    )
    if len(drawn) > 1:
        words = f"r, start moved by {chosen.moved or 0:g} mm"
        if chosen.shifted is not None:
            words = f"r, all moved by {chosen.shifted:g} cells"
        itself = [r(ends[0][key][:, 0], ends[1][key][:, 0]) for key in ends[0]]
        itself += [""] * (len(table) - 1 - len(itself))
        table = [[*row, cell] for row, cell in zip(table, (words, *itself), strict=True)]
    if chosen.moved is not None:
        print(f"{words}: {', '.join(f'{n} {r(truths[0][n], truths[1][n])}' for n in TRUTHS)}.")
    print()
    for row in (table[0], ["---"] * len(table[0]), *table[1:]):
        print(f"| {' | '.join(row)} |")


if __name__ == "__main__":
    main()

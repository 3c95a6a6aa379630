"""What the paper leaves open, by history matching of what it publishes about models alone.

    python -m benchmarks.calibrate --waves 3 --points 40 --scenes 32 --store DIR

draws points of the open choices (`calibration/space.py`), measures each on scenes of its own
through a store, emulates every output, rules out what is implausible, and draws again in the rest
(`calibration/matching.py`). DIR keeps everything: the same command goes on after any interruption.
Writes DIR/report.md, its figures, and DIR/recommended.toml. With `--hold water.cohesion=0`, waves
that are not drawn yet, and the recommended point, have that value.

    python -m benchmarks.calibrate --check POINT.toml --seeds 3 --scenes 120 --store DIR

measures a point, and the product as it stands, on fresh scenes, and prints a table beside the
paper's.
"""

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

from threadpoolctl import threadpool_limits

from benchmarks.calibration import check, space
from benchmarks.calibration.emulator import LEAST_POINTS
from benchmarks.calibration.measure import LEAST_SCENES
from benchmarks.calibration.report import write_report
from benchmarks.calibration.waves import Request, run_waves
from pourcast.cli.terminal import progress_bar
from pourcast.cores import available_cores
from pourcast.errors import InputError


def main(words: list[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--waves", type=_from(1), default=3)
    parser.add_argument(
        "--points", type=_from(LEAST_POINTS), default=60, help="points in the first wave"
    )
    parser.add_argument("--later-points", type=_from(2), help="points in each later wave; as many")
    parser.add_argument("--scenes", type=_from(LEAST_SCENES), default=30, help="scenes at a point")
    parser.add_argument("--seed", type=_from(0), default=1)
    parser.add_argument("--workers", type=_from(1), default=available_cores())
    parser.add_argument("--store", type=Path, required=True, help="folder of all results")
    parser.add_argument(
        "--hold",
        nargs="*",
        default=[],
        metavar="CHOICE=VALUE",
        help="choices with a value that later waves and the recommended point are to have",
    )
    parser.add_argument("--check", type=Path, nargs="*", help="points to be measured, as TOML")
    parser.add_argument("--seeds", type=_from(1), default=3, help="sets of scenes of a check")
    given = parser.parse_args(words)
    begin = time.monotonic()
    try:
        if given.check is None:
            held = space.read_held(given.hold)
            later = given.later_points or given.points
            request = Request(
                given.waves, given.points, later, given.scenes, given.seed, given.workers, held
            )
            # Emulators are small: threads that wait for one another cost more than they give.
            with progress_bar() as report, threadpool_limits(1):
                left, last = run_waves(request, given.store, report)
                print(write_report(left, last, request, given.store))
        else:
            points = {"the product as it stands": space.product_point()}
            points |= {str(path.stem): space.read_point(path) for path in given.check}
            with progress_bar() as report:
                found = check.measure_checks(
                    points, given.scenes, given.seeds, given.seed, given.store / "check",
                    given.workers, report,
                )  # fmt: skip
            print(check.check_table(found))
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted: the same command goes on", file=sys.stderr)
        return 130
    print(f"{(time.monotonic() - begin) / 60:.1f} minutes", file=sys.stderr)
    return 0


def _from(least: int) -> Callable[[str], int]:
    """Reads a whole number, `least` at least."""

    def whole_number(word: str) -> int:
        if not word.isdecimal() or int(word) < least:
            raise argparse.ArgumentTypeError(f"expected at least {least}, found {word!r}")
        return int(word)

    return whole_number


if __name__ == "__main__":
    sys.exit(main())

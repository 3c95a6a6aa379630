"""An experiment of another package, with a goal, a family and a liquid of its own.

`examples/pegs` is installed as a user would, into a folder of its own, and every command is
called with the experiment's name in processes that see it.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from pourcast.scenes.scene_file import SceneFile

ROOT = Path(__file__).parents[1]

COMMANDS = (
    "scenes pegs -n 3 --seed 1 -o scenes.json",
    "new pegs study --scenes 4 --practice 1",
    "predict study -m water-ife -m ife:liquid=oil,n_particles=25 -m gravity --liquid oil -o j.csv",
    "show study -m ife:liquid=oil,n_particles=25,zeta_sigma=0 -o oil.png",
    "sweep study --grid grid.toml --workers 1",
    "stimuli study --preview --scenes 1 --seconds 0.2 --workers 1",
    "experiment simulate study --observers 6",
    "compare study --responses study/responses/simulated.csv -m water-ife -m gravity",
    "report study --responses study/responses/simulated.csv -m water-ife -m gravity --films 0"
    " --studies 0",
    "experiment serve study --check",
    "list",
)

GRID = """
[[models]]
model = "ife"
liquids = ["water", "oil"]
parameters.liquid = ["trial", "oil"]
parameters.n_particles = 15
parameters.zeta_sigma = 0
"""

RUN = """
import shlex, sys
from pourcast import cli
for line in sys.argv[1:]:
    print("$", line, flush=True)
    if code := cli.run(shlex.split(line)):
        sys.exit(code)
"""


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """Variables of processes that see the package."""
    folder = tmp_path_factory.mktemp("installed")
    source = folder / "source"
    shutil.copytree(ROOT / "examples" / "pegs", source)
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps"]
    install += ["--no-build-isolation", "--target", folder / "site", source]
    subprocess.run(install, check=True, capture_output=True, text=True)
    paths = [str(folder / "site"), os.environ.get("PYTHONPATH", "")]
    return os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}


def test_every_command_works_with_it_by_its_name(environment, tmp_path):
    (tmp_path / "grid.toml").write_text(GRID)
    done = subprocess.run(
        [sys.executable, "-c", RUN, *COMMANDS],
        check=False, cwd=tmp_path, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, (done.stdout[-2000:], done.stderr[-2000:])
    assert 'experiment = "pegs"' in (tmp_path / "study" / "study.toml").read_text()
    judgments = pd.read_csv(tmp_path / "j.csv")
    assert set(judgments["liquid"]) == {"oil"}
    assert judgments["judgment"].between(0.0, 1.0).all()
    swept = pd.read_parquet(tmp_path / "study" / "judgments" / "grid.parquet")
    assert set(swept["liquid"]) == {"water", "oil"}
    page = (tmp_path / "study" / "report" / "report.html").read_text()
    assert "oil trials" in page
    assert "pegs" in done.stdout
    assert "6 simulated observers, 8 trials each" in done.stdout


def test_its_scenes_are_refused_where_it_is_not_installed(environment, tmp_path):
    subprocess.run(
        [sys.executable, "-c", RUN, "scenes pegs -n 1 -o scenes.json"],
        check=True, cwd=tmp_path, env=environment, capture_output=True,
    )  # fmt: skip
    with pytest.raises(ValueError, match=r"there is no 'middle-bin'; .*is the package"):
        SceneFile.model_validate_json((tmp_path / "scenes.json").read_bytes())


def test_it_keeps_the_contracts(environment):
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-k", "pegs or middle or oil"]
    done = subprocess.run(
        [*command, str(ROOT / "tests" / "test_contracts.py")],
        check=False, cwd=ROOT, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-3000:]
    assert "8 passed" in done.stdout

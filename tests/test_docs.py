"""Every command and every snippet of the documentation runs."""

import json
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
import urllib.request
import zipfile
from pathlib import Path

import pytest

from pourcast import cli
from pourcast.experiment.design import materials
from pourcast.scenes.liquids.registry import liquid_from
from pourcast.sweep import grid
from pourcast.sweep.grid import parse_grid
from tests.experiment.server_process import ServerProcess

ROOT = Path(__file__).parents[1]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
CONTRIBUTING = ROOT / "CONTRIBUTING.md"
COMMANDS = (
    "demo", "scenes", "new", "predict", "show", "import", "export", "sweep", "models", "list", "bench",
    "experiment simulate", "experiment serve", "experiment status", "experiment data",
    "experiment export", "stimuli", "convnet train", "convnet show", "compare", "report", "reproduce", "recover", "power", "mixture", "multiverse",
)  # fmt: skip

LONG_LINES = (
    "pourcast reproduce exp1 --quick -o out",
    "pourcast reproduce exp2 --quick --carry-from out -o out2",
)
"""Lines of minutes: `tests/e2e/test_report.py` runs them, as one of the slow tests; CI does."""

CYCLES_LINE = (
    "pourcast stimuli looks --renderer cycles --samples 16 --size 320x480 --scenes 1 --seconds 0.2"
)
"""Needs Blender: `tests/stimuli/test_cycles.py` runs it, likewise."""


def snippets(page):
    """(language, text) of the fenced blocks of a page."""
    return re.findall(r"^```(\w+)\n(.*?)^```", page.read_text(), flags=re.MULTILINE | re.DOTALL)


WITHDRAWS = {
    "format": "pourcast-records", "session": "0123456789abcdef", "group": 0, "place": 0,
    "identifiers": {"PROLIFIC_PID": "5f0c1e9ab3d4e5f60718293a"},
}  # fmt: skip
"""The first line of somebody whom the guide lets withdraw."""


def bring_answers():
    """The files that the guide takes answers in from: the pilot's own, and who withdraws."""
    for name in ("answers.jsonl", "osf-folder/one.json"):
        Path(name).parent.mkdir(exist_ok=True)
        shutil.copyfile("pilot/responses.jsonl", name)
    with zipfile.ZipFile("results.jrzip", "w") as archive:
        archive.writestr("comp-result_1/data.txt", json.dumps(WITHDRAWS))


def serve(arguments):
    """Serve (on a port that is free), ask for the page that a link leads to, and end it.

    What is shown is made here first, where it is short (`_quicker`); the server then takes it.
    """
    study, *options = arguments
    assert cli.run(["experiment", "serve", study, "--check"]) == 0
    with ServerProcess(study, *options) as server:
        # As the web server before it would ask, where there is one.
        here = f"http://127.0.0.1:{server.port}/?{server.lab.rpartition('?')[2]}"
        with urllib.request.urlopen(here) as page:
            assert b"<main" in page.read()


def install(package):
    """A package installed as its user would, but into a folder of its own; which one."""
    folder = package.resolve().parent.parent / "installed"
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps"]
    command += ["--no-build-isolation", "--target", folder, package]
    subprocess.run(command, check=True, capture_output=True, text=True)
    return folder


COARSER = {
    "to = 20, step = 1 }": "to = 16, step = 8 }", "to = 16, step = 1 }": "to = 16, step = 8 }",
    "sigma = 4": "sigma = 1", "[0, 4]": "[0, 1]", "[25, 50]": "25",
}  # fmt: skip
"""What of the grid `quick` makes a smaller one: few values, and narrow windows around them."""


@pytest.fixture
def _quicker(monkeypatch):
    """Let `quick` be quicker still, and what is shown for want of films be short.

    The slow reproductions sweep the whole grid; films as long as they are have tests of their own.
    """
    monkeypatch.setattr(materials, "QUICK", materials.QUICK.model_copy(update={"seconds": 0.5}))

    def coarse(text, name, *more):
        for whole, part in COARSER.items() if name == "quick" else ():
            text = text.replace(whole, part)
        return parse_grid(text, name, *more)

    monkeypatch.setattr(grid, "parse_grid", coarse)
    assert 90 < sum(1 for _ in grid.read_grid("quick").points()) < 324 / 2


@pytest.mark.usefixtures("_quicker")
@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_page_runs_from_top_to_bottom(page, tmp_path, monkeypatch, capsys):
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "snippet"}
    for language, text in snippets(page):
        if language == "python":
            exec(compile(text, str(page), "exec"), names)
        if language == "toml" and (file := re.match(r"# added to (\S+)\n", text)):
            with Path(file[1]).open("a") as stream:
                stream.write(text)
        for line in text.splitlines() if language == "sh" else ():
            if line in (*LONG_LINES, CYCLES_LINE) or "convnet" in line:  # see tests/networks
                continue
            if "--import answers.jsonl" in line:
                bring_answers()
            if line.startswith("pip install ./examples/"):
                monkeypatch.syspath_prepend(install(Path(line.removeprefix("pip install "))))
            elif line.startswith("pourcast experiment serve") and "--check" not in line:
                serve(shlex.split(line)[3:])
            elif line.startswith("pourcast "):
                assert cli.run(shlex.split(line)[1:]) == 0, (line, capsys.readouterr().err)
            else:
                assert line.startswith("python3 -m venv"), f"{line!r} is run by no test"


@pytest.mark.parametrize(
    "page", [*PAGES, CONTRIBUTING], ids=lambda page: str(page.relative_to(ROOT))
)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text()):
        if "://" not in target:
            assert (page.parent / target).exists(), target


def test_every_command_is_in_the_documentation():
    text = "\n".join(page.read_text() for page in PAGES)
    for command in COMMANDS:
        assert f"pourcast {command}" in text


def test_the_grid_of_the_how_to_is_the_example():
    page = ROOT / "docs" / "how-to" / "sweeps.md"
    text = next(text for language, text in snippets(page) if language == "toml")
    assert (ROOT / "examples" / "grid.toml").read_text().endswith(text)


def test_the_model_of_the_how_to_is_the_example():
    page = ROOT / "docs" / "how-to" / "add-a-model.md"
    shown = next(text for language, text in snippets(page) if language == "python")
    package = (ROOT / "examples" / "plumb" / "src" / "pourcast_plumb" / "__init__.py").read_text()
    assert shown.startswith(package.partition("\n\n")[2])
    grids = [text for language, text in snippets(page) if text.startswith("[[models]]")]
    assert all(text in (ROOT / "examples" / "rivals.toml").read_text() for text in grids)


def test_the_scene_of_the_reference_is_the_example():
    from pourcast.scenes.scene_file import parse_scenes, read_scenes

    page = ROOT / "docs" / "reference" / "scene-file.md"
    text = next(text for language, text in snippets(page) if language == "json")
    assert parse_scenes(text, "page") == read_scenes(ROOT / "examples" / "ramp.json")


def test_the_files_that_are_shown_to_contributors_work():
    names = {"__name__": "shown"}
    kinds = [language for language, _ in snippets(CONTRIBUTING)]
    assert kinds.count("python") == 6  # model, family, goal, experiment, statistic, figure
    for language, text in snippets(CONTRIBUTING):
        if language == "python":
            exec(compile(text, str(CONTRIBUTING), "exec"), names)
        if language == "toml":
            assert liquid_from("shown", tomllib.loads(text), "CONTRIBUTING.md").film_seconds == 5.0


def test_the_drawing_of_the_house_is_that_of_its_imports():
    drawn = subprocess.run(
        [sys.executable, ROOT / "docs" / "house.py"], check=True, capture_output=True, text=True
    ).stdout
    assert drawn == next(text for kind, text in snippets(CONTRIBUTING) if kind == "mermaid")


WRONG = ROOT / "docs" / "how-to" / "what-can-go-wrong.md"


def said_in(page):
    """Code in the middle columns of a page's tables: what the software says."""
    rows = [line.split(" | ") for line in page.read_text().splitlines() if line.startswith("| ")]
    return [said for row in rows for said in re.findall(r"`([^`]+)`", row[1])]


def test_what_can_go_wrong_is_told_in_the_words_in_which_it_is_said():
    kinds = (".py", ".toml", ".html")
    files = [path for path in (ROOT / "src").rglob("*") if path.suffix in kinds]
    source = "\n".join(path.read_text() for path in files if "node_modules" not in path.parts)
    # Python's sentences go over several lines.
    source = re.sub(r'"\s*\n\s*f?"', "", source)
    assert len(said_in(WRONG)) > 40
    for said in said_in(WRONG):
        # What is filled in differs: file names, numbers, causes.
        for part in re.split(r"responses\S*|\([^)]*\)|\d+|[;:]|--\w+", said):
            assert part.strip() in source, (said, part)

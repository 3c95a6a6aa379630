"""Names of the state of the code that results depend on, so that stores know what is stale.

A result depends on the file that makes it and on all files that this imports, directly or not,
within pourcast and within the file's own package. Comments, docstrings and blank lines don't
count, nor do modules that decide nothing, nor what a goal says to people.
"""

import ast
import hashlib
import importlib
import importlib.util
import io
import sys
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

_OURS = "pourcast"

_DECIDE_NOTHING = tuple(
    f"{_OURS}.{name}" for name in ("errors", "extras", "files", "progress", "registry")
)

_WORDS = ("share", "words", "answer_picture")
"""What a goal's class says and shows to people."""


@cache
def code_version(
    modules: tuple[str, ...], without: tuple[str, ...] = (), *, words: bool = True
) -> str:
    """Name of the state of some modules and of all that they import.

    Parameters
    ----------
    modules
        Their names.
    without
        Modules and packages that are left out, and not followed.
    words
        Whether what classes say and show to people (`_WORDS`) counts.

    Returns
    -------
    str
        12 hexadecimal digits.
    """
    digest = hashlib.sha256()
    for name, path in sorted(_imported(modules, (*_DECIDE_NOTHING, *without)).items()):
        digest.update(f"{name} {_digest_of(path, words=words)}".encode())
    return digest.hexdigest()[:12]


def defining_modules(kind: type, base: type) -> tuple[str, ...]:
    """Modules that define a class and those that it inherits from, up to and without a base."""
    classes = [each for each in kind.__mro__ if issubclass(each, base) and each is not base]
    return tuple(dict.fromkeys(each.__module__ for each in classes))


def read_source(path: Path) -> str:
    """Text of a source file."""
    return path.read_text(encoding="utf-8")


def code_of(source: str) -> str:
    r"""Source code without comments, docstrings and blank lines.

    Examples
    --------
    >>> code_of('def f(x):\n    "Twice."\n    return 2 * x  # see g\n').split("\n")
    ['def f ( x ) :', '{', 'return 2 * x', '}']
    """
    code: list[str] = []
    statement: list[tokenize.TokenInfo] = []
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type in (tokenize.INDENT, tokenize.DEDENT):
            code.append("{" if token.type == tokenize.INDENT else "}")
        elif token.type == tokenize.NEWLINE:
            # What consists of strings alone is a docstring.
            if any(part.type != tokenize.STRING for part in statement):
                code.append(" ".join(part.string for part in statement))
            statement = []
        elif token.type not in (tokenize.COMMENT, tokenize.NL):
            statement.append(token)
    return "\n".join(code)


@cache
def _digest_of(path: Path, *, words: bool) -> str:
    source = read_source(path)
    code = code_of(source if words else _without_words(source))
    return hashlib.sha256(code.encode()).hexdigest()


def _imported(modules: tuple[str, ...], without: tuple[str, ...]) -> dict[str, Path]:
    """Files of modules and of all that they import, by the modules' names."""
    packages = {_OURS, *(name.partition(".")[0] for name in modules)}
    files: dict[str, Path] = {}
    left = list(modules)
    while left:
        name = left.pop()
        outside = name.partition(".")[0] not in packages
        if outside or name in files or any(f"{name}.".startswith(f"{one}.") for one in without):
            continue
        path = _file_of(name)
        if path is not None:
            files[name] = path
            left += _imports_of(path, name if path.stem == "__init__" else name.rpartition(".")[0])
    return files


def _file_of(name: str) -> Path | None:
    """Source file of a module; None if there is none, as where a class is imported from one."""
    path = getattr(sys.modules.get(name), "__file__", None)
    if path is None:
        try:
            spec = importlib.util.find_spec(name)
        except (ImportError, ValueError):
            return None
        path = spec.origin if spec is not None and spec.has_location else None
    return Path(path) if path and path.endswith(".py") and Path(path).exists() else None


@cache
def _imports_of(path: Path, package: str) -> list[str]:
    """Names of modules that a module of a package imports, and of what it imports from them."""
    return list(_imports_in(ast.parse(read_source(path)), package))


def _imports_in(tree: ast.AST, package: str) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module == _OURS and node.level == 0:
            # Its face imports nothing before it is asked for it.
            face = importlib.import_module(_OURS)
            yield from (getattr(getattr(face, a.name, None), "__module__", "") for a in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = node.module or ""
            if node.level:
                module = importlib.util.resolve_name("." * node.level + module, package)
            yield module
            yield from (f"{module}.{alias.name}" for alias in node.names)


def _without_words(source: str) -> str:
    """A module without what its classes say to people, and without what only that uses."""
    tree = ast.parse(source)
    bodies = [tree.body, *(node.body for node in tree.body if isinstance(node, ast.ClassDef))]
    assigned = [
        (statement, _assigned_name(statement))
        for body in bodies
        for statement in body
        if isinstance(statement, ast.Assign | ast.AnnAssign)
    ]
    gone = [one for one, name in assigned if name in _WORDS and one not in tree.body]
    used = {node.id for one in gone for node in ast.walk(one) if isinstance(node, ast.Name)}
    inside = {id(node) for one in gone for node in ast.walk(one)}
    elsewhere = {
        node.id
        for node in ast.walk(tree)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and id(node) not in inside
    }
    gone += [one for one, name in assigned if one in tree.body and name in used - elsewhere]
    lines = source.splitlines(keepends=True)
    for statement in gone:
        for number in range(statement.lineno - 1, statement.end_lineno or statement.lineno):
            lines[number] = "\n"
    return "".join(lines)


def _assigned_name(statement: ast.Assign | ast.AnnAssign) -> str:
    target = statement.target if isinstance(statement, ast.AnnAssign) else statement.targets[0]
    return target.id if isinstance(target, ast.Name) else ""

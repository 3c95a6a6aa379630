"""Builds the participants' page (TypeScript) when the package is built, and ships it in the wheel.

It needs Node.js 20 or newer with npm, and the npm registry. Without them the package is built all
the same, and `pourcast experiment serve` says what is missing.
"""

import shutil
import subprocess
from hashlib import sha256
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

WEB = Path(__file__).parent / "src" / "pourcast" / "experiment" / "page" / "web"
DIST = WEB / "dist"
# Not `tests/`: linter and tests are a package of their own, which no installation waits for.
SOURCES = ("package-lock.json", "package.json", "build.mjs", "tsconfig.json", "src/**/*")


def _digest() -> str:
    """Name of the sources' state: the page is built again only if they changed."""
    found = sha256()
    for path in sorted(path for pattern in SOURCES for path in WEB.glob(pattern)):
        if path.is_file():
            found.update(path.relative_to(WEB).as_posix().encode() + b"\0" + path.read_bytes())
    return found.hexdigest()


class BuildHook(BuildHookInterface[Any]):
    """Hatchling's hook for wheels, editable ones too."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the page if it isn't there, or is older than its sources."""
        stamp = DIST / "sources.sha256"
        digest = _digest()
        if not stamp.is_file() or stamp.read_text() != digest:
            problem = _build()
            if problem:
                self.app.display_warning(f"the participants' page was not built: {problem}")
                return
            stamp.write_text(digest)
        build_data["artifacts"].append("src/pourcast/experiment/page/web/dist/**")


def _build() -> str:
    """Build the page; returns what went wrong, if anything did."""
    npm = shutil.which("npm")
    if npm is None:
        return "npm was not found; install Node.js 20 or newer, and install pourcast again"
    # Where the registry can't be reached, the installation shall not hang for long.
    quick = ["--fetch-retries=1", "--fetch-timeout=60000"]
    for command in (["ci", "--no-audit", "--no-fund", *quick], ["run", "build"]):
        done = subprocess.run([npm, *command], check=False, cwd=WEB, capture_output=True, text=True)
        if done.returncode:
            return f"npm {' '.join(command)}: {done.stdout[-1000:]}{done.stderr[-1000:]}"
    return ""

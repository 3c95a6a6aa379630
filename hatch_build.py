"""Builds the participants' page (TypeScript) when the package is built, and ships it in the wheel.

It needs Node.js 20 or newer with npm. Without them the package is built all the same, and
`pourcast experiment serve` says what is missing.
"""

import shutil
import subprocess
from hashlib import sha256
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

WEB = Path(__file__).parent / "src" / "pourcast" / "experiment" / "web"
DIST = WEB / "dist"
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
            npm = shutil.which("npm")
            if npm is None:
                self.app.display_warning(
                    "npm was not found: the participants' page is not built; install Node.js 20 "
                    "or newer for `pourcast experiment serve`, and install again"
                )
                return
            for command in (["ci", "--no-audit", "--no-fund"], ["run", "build"]):
                done = subprocess.run(
                    [npm, *command], check=False, cwd=WEB, capture_output=True, text=True
                )
                if done.returncode:
                    raise RuntimeError(
                        f"npm {' '.join(command)}: {done.stdout[-2000:]}{done.stderr[-2000:]}"
                    )
            stamp.write_text(digest)
        build_data["artifacts"].append("src/pourcast/experiment/web/dist/**")

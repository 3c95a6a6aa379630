"""The participants' page as it is built from `web/`, and what every copy of it is told."""

import html
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pourcast.errors import InputError
from pourcast.experiment.design.materials import Materials
from pourcast.experiment.design.settings import liquids_of
from pourcast.files import write_text
from pourcast.scenes.goals.base import Goal
from pourcast.scenes.liquids.registry import resolve_liquid
from pourcast.study.folder import study_liquids

WEB = Path(__file__).parent / "web"
DIST = WEB / "dist"

_BEFORE = ("reaching", "offline", "silent", "failing", "broken", "unloaded", "old", "scriptless")
"""Words that the page brings, for when no server has told it any."""


def require_page() -> None:
    """Refuse to go on without the page.

    Raises
    ------
    InputError
        If it has not been built.
    """
    if not (DIST / "index.html").is_file():
        raise InputError(
            f"{DIST}: the participants' page has not been built; install Node.js 20 or newer and "
            f"run: npm --prefix {WEB} ci && npm --prefix {WEB} run build"
        )


def page_html(texts: Mapping[str, Any], language: str) -> str:
    """The page, in a study's words."""
    page = texts["page"]
    text = (DIST / "index.html").read_text(encoding="utf-8")
    words = {name: page[name] for name in ("title", *_BEFORE)} | {"language": language}
    for name, word in words.items():
        text = text.replace(f"@{name.upper()}@", html.escape(word))
    return text


def write_page(folder: Path, texts: Mapping[str, Any], language: str, transport: str) -> None:
    """Write the page and its assets for a host that isn't ours.

    Parameters
    ----------
    folder
        Where to.
    texts, language
        The study's words.
    transport
        Who keeps the records: `static` or `jatos`.
    """
    text = page_html(texts, language).replace('content="server"', f'content="{transport}"')
    if transport == "jatos":
        text = text.replace("<link ", '<script src="jatos.js"></script>\n    <link ', 1)
    write_text(folder / "index.html", text)
    shutil.copytree(DIST / "assets", folder / "assets")


def participant_view(materials: Materials, texts: Mapping[str, Any]) -> dict[str, Any]:
    """What every browser must know of an experiment."""
    design, box = materials.design, materials.scenes[0].box
    return {
        "texts": texts,
        "answer_picture": _answer_picture(type(materials.scenes[0].goal)),
        "colours": _colours(materials),
        "aspect": box.width / box.height,
        "slider": design.slider.model_dump(),
        **design.model_dump(
            include={
                "contact",
                "minutes",
                "comprehension_attempts",
                "minimum_width",
                "minimum_height",
                "fullscreen",
            }
        ),
    }


def _answer_picture(goal: type[Goal]) -> dict[str, Any]:
    """The small picture of an answer, as the browser draws it."""
    picture = goal.answer_picture
    columns = [column._asdict() for column in picture.columns]
    return {"columns": columns, "parts": picture.parts}


def _colours(materials: Materials) -> dict[str, str]:
    """Colour of each liquid that the design shows."""
    own = study_liquids(materials.study)
    return {
        liquid: resolve_liquid(liquid, materials.scenes[0], own).colour
        for liquid in liquids_of(materials.design)
    }

"""The experiment as files: for JATOS, or for any web host, without our server."""

import json
import shutil
import tempfile
import uuid
import zipfile
from pathlib import Path
from typing import Any

from pourcast.errors import InputError
from pourcast.experiment.design.materials import Materials
from pourcast.experiment.design.schedule import OWN_ORDERS
from pourcast.experiment.design.settings import Design, texts_of
from pourcast.experiment.page.pages import participant_view, require_page, write_page
from pourcast.files import check_empty, replacing, write_text

_STUDY_UUIDS = uuid.UUID("6f0f4f0c-5d3a-4a36-9d2c-0c6ce3d0a3f1")
"""Namespace of JATOS's ids: the same study has the same id, however often it is exported."""


def export_static(folder: Path, materials: Materials, *, datapipe: str = "") -> None:
    """Write a folder for any web host.

    Parameters
    ----------
    folder
        Must not exist, or be empty.
    materials
        Scenes, stimuli and design.
    datapipe
        Id of the experiment at DataPipe, which sends the data to the OSF. Without it
        each participant downloads a file and sends it by other ways.

    Raises
    ------
    InputError
        If the folder holds something already, or can't be written.
    """
    check_empty(folder)
    _write(folder, materials, "static", datapipe)


def export_jatos(path: Path, materials: Materials) -> None:
    """Write a study archive for JATOS: assets, and a .jas file (version 3) that describes them.

    Parameters
    ----------
    path
        A .jzip file.
    materials
        Scenes, stimuli and design.

    Raises
    ------
    InputError
        If the extension is wrong, or the file can't be written.
    """
    if path.suffix != ".jzip":
        raise InputError(f"{path}: expected a name that ends in .jzip")
    name = f"pourcast-{materials.study.resolve().name}"
    with tempfile.TemporaryDirectory() as temporary:
        assets = Path(temporary) / name
        _write(assets, materials, "jatos", "")
        described = json.dumps(_jas(name, materials.design, materials.digest), indent=1)
        with replacing(path) as archive, zipfile.ZipFile(archive, "w") as jzip:
            jzip.writestr(_entry(f"{name}.jas"), described)
            for file in sorted(assets.rglob("*")):
                if file.is_file():
                    inside = file.relative_to(temporary).as_posix()
                    jzip.writestr(_entry(inside), file.read_bytes())


def _entry(name: str) -> zipfile.ZipInfo:
    """An entry without a date: the same study makes the same bytes."""
    entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
    entry.compress_type = zipfile.ZIP_DEFLATED
    return entry


def _write(folder: Path, materials: Materials, transport: str, datapipe: str) -> None:
    require_page()
    design = materials.design
    orders = OWN_ORDERS if design.order == "own" else 1
    places = [
        {
            "group": group,
            "place": place,
            "steps": [step.for_participant() for step in materials.steps(group, place)],
        }
        for group in range(len(design.groups))
        for place in range(orders)
    ]
    recruiting = design.recruiting
    texts = texts_of(materials.study, design)
    plan = participant_view(materials, texts) | {
        "places": places,
        "codes": recruiting.codes,
        "redirect": recruiting.redirect,
        "datapipe": datapipe,
    }
    write_text(folder / "plan.json", json.dumps(plan, separators=(",", ":")) + "\n")
    write_page(folder, texts, design.language, transport)
    for name, file in materials.published.items():
        (folder / "media").mkdir(exist_ok=True)
        shutil.copyfile(file, folder / "media" / name)


def _jas(name: str, design: Design, digest: str) -> dict[str, Any]:
    """JATOS's description of a study (its `Study`, `Component` and `Batch`, as it writes them)."""

    def own(part: str) -> str:
        return str(uuid.uuid5(_STUDY_UUIDS, f"{digest} {part}"))

    return {
        "version": "3",
        "data": {
            "uuid": own("study"),
            "title": design.title,
            "description": "Made by pourcast. Import results with `pourcast experiment data "
            "STUDY --import FILE`.",
            "groupStudy": False,
            "linearStudy": False,
            "dirName": name,
            "comments": "",
            "jsonData": None,
            "endRedirectUrl": "",
            "componentList": [
                {
                    "uuid": own("component"),
                    "title": design.title,
                    "htmlFilePath": "index.html",
                    "reloadable": True,
                    "active": True,
                    "comments": "",
                    "jsonData": None,
                }
            ],
            "batchList": [
                {
                    "uuid": own("batch"),
                    "title": "Default",
                    "active": True,
                    "maxActiveMembers": None,
                    "maxTotalMembers": None,
                    "maxTotalWorkers": None,
                    "allowedWorkerTypes": [
                        "PersonalSingle",
                        "PersonalMultiple",
                        "GeneralSingle",
                        "GeneralMultiple",
                        "Jatos",
                        "MT",
                        "MTSandbox",
                    ],
                    "comments": None,
                    "jsonData": None,
                }
            ],
        },
    }

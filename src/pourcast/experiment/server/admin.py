"""The admin page: how the experiment goes, and its data; for whoever has the token."""

import hmac
import time
from importlib.resources import files
from typing import Any

import numpy as np
import pandas as pd
from jinja2 import Environment, select_autoescape
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response
from starlette.routing import Route

from pourcast.errors import StoreError
from pourcast.experiment.data.overview import overview
from pourcast.experiment.data.tables import participants_table, trials_table
from pourcast.experiment.server.live_experiment import LiveExperiment
from pourcast.tables import csv_bytes

_BINS = 10
_HEIGHT = 40.0


def admin_routes(experiment: LiveExperiment) -> tuple[Route, ...]:
    """Routes of the admin page; each refuses whoever has not the token."""
    admin = _Admin(experiment)
    return (
        Route("/admin", admin.page),
        Route("/admin/style.css", admin.style),
        Route("/admin/trials.csv", admin.trials),
        Route("/admin/participants.csv", admin.participants),
    )


class _Admin:
    def __init__(self, experiment: LiveExperiment) -> None:
        self.experiment = experiment
        environment = Environment(autoescape=select_autoescape(default=True))
        own = files("pourcast.experiment.server")
        self._template = environment.from_string(own.joinpath("admin.html").read_text("utf-8"))
        self._style = own.joinpath("admin.css").read_text("utf-8")

    async def page(self, request: Request) -> Response:
        """How the experiment goes."""
        self._check(request)
        return HTMLResponse(await run_in_threadpool(self._html))

    async def style(self, request: Request) -> Response:
        """The page's style sheet."""
        self._check(request)
        return Response(self._style, media_type="text/css")

    async def trials(self, request: Request) -> Response:
        """The table of trials."""
        self._check(request)
        return await run_in_threadpool(
            lambda: _csv(trials_table(self.experiment.storage), "trials.csv")
        )

    async def participants(self, request: Request) -> Response:
        """The table of participants."""
        self._check(request)
        return await run_in_threadpool(
            lambda: _csv(participants_table(self.experiment.storage), "participants.csv")
        )

    def _check(self, request: Request) -> None:
        given = request.query_params.get("token", "").encode()
        # In constant time: how long it takes tells nothing of the token.
        if not hmac.compare_digest(given, self.experiment.storage.admin_token.encode()):
            raise HTTPException(404, "not found")

    def _html(self) -> str:
        experiment = self.experiment
        try:
            content = self._content()
        except StoreError as error:
            content = {"warnings": list(dict.fromkeys([*experiment.failures, str(error)]))}
        return self._template.render(
            title=experiment.texts["page"]["title"],
            study=experiment.study.name,
            token=experiment.storage.admin_token,
            now=time.strftime("%Y-%m-%d %H:%M:%S"),
            **content,
        )

    def _content(self) -> dict[str, Any]:
        """What the page shows of the database."""
        experiment = self.experiment
        experiment.storage.drop_stale(experiment.design.largest_gap, experiment.clock())
        seen = overview(experiment.storage, experiment.journal)
        table = participants_table(experiment.storage)
        return {
            "judgments": seen.judgments,
            "warnings": [*seen.warnings, *experiment.failures],
            "states": seen.states,
            "liquids": ["+".join(group) for group in experiment.design.groups],
            "median_rt": "" if np.isnan(seen.median_rt) else f"{seen.median_rt:.1f}",
            "participants": [_row(one) for one in table.to_dict("records")],
            "scenes": [
                _histogram(scene, liquid, answers)
                for (liquid, scene), answers in seen.responses.items()
            ],
        }


def _row(one: dict[Any, Any]) -> dict[str, Any]:
    seconds = one["median_rt"]
    return one | {
        "seconds": "" if pd.isna(seconds) else f"{seconds:.1f}",
        "minutes": f"{one['duration'] / 60:.1f}",
    }


def _histogram(scene: str, liquid: str, answers: list[float]) -> dict[str, Any]:
    counts = np.histogram(answers, bins=_BINS, range=(0.0, 1.0))[0]
    heights = _HEIGHT * counts / max(1, counts.max())
    bars = [
        {"x": 10 * k, "y": f"{_HEIGHT + 1 - height:.1f}", "height": f"{height:.1f}"}
        for k, height in enumerate(heights)
    ]
    return {
        "name": scene,
        "liquid": liquid,
        "kind": liquid,
        "count": len(answers),
        "counts": counts.tolist(),
        "bars": bars,
    }


def _csv(table: pd.DataFrame, name: str) -> Response:
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return Response(csv_bytes(table), media_type="text/csv", headers=headers)

"""The experiment over HTTP: pages, pictures, and the requests that keep judgments."""

import asyncio
import contextlib
import json
import re
from collections.abc import AsyncIterator, Sequence
from typing import Annotated, Any, Literal, Protocol, TypeVar

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pourcast.errors import StoreError
from pourcast.experiment.design.links import is_unaccepted, unfilled, visitor
from pourcast.experiment.design.steps import Step
from pourcast.experiment.page.pages import DIST, page_html, participant_view, require_page
from pourcast.experiment.server.addresses import visitors_place
from pourcast.experiment.server.live_experiment import LiveExperiment, NoSuchStepError
from pourcast.experiment.storage.record_bodies import MAX_BODY
from pourcast.experiment.storage.sessions import COMPLETE, DECLINED, OPEN, Refusal, Session

_REFUSED = {
    "link": 403,
    "unfilled": 403,
    "unaccepted": 403,
    "unlisted": 403,
    "full": 403,
    "again": 403,
    "late": 410,
    "gone": 401,
    "busy": 429,
}

_HEADERS = {
    "Content-Security-Policy": "; ".join(
        (
            "default-src 'none'",
            "script-src 'self'",
            "style-src 'self'",
            "img-src 'self' blob:",
            "media-src 'self' blob:",
            "connect-src 'self'",
            "base-uri 'none'",
            "form-action 'none'",
            "frame-ancestors 'none'",
        )
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=(), payment=()",
}

Model = TypeVar("Model", bound=BaseModel)

_Tab = Annotated[str, StringConstraints(pattern="^[A-Za-z0-9_-]{8,64}$")]
_Parameter = Annotated[str, StringConstraints(max_length=200)]


class _Content(BaseModel):
    """What a request says."""

    model_config = ConfigDict(extra="forbid")


class _BeginContent(_Content):
    request: _Tab
    tab: _Tab
    link: dict[_Parameter, _Parameter] = Field(max_length=20)


class _ResumeContent(_Content):
    tab: _Tab | None = None


class _RecordContent(_Content):
    tab: _Tab
    body: dict[str, Any]


class _FinishContent(_Content):
    state: Literal["complete", "declined", "screened_out", "failed_check"]
    # A page of before that says no tab can only be complete.
    tab: _Tab = ""


class SafeHeaders:
    """Middleware: headers that let the page load nothing that isn't ours, and be framed nowhere."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Add the headers to every answer."""

        async def send_safe(message: Message) -> None:
            if message["type"] == "http.response.start":
                given = {name.lower() for name, _ in message["headers"]}
                extra = dict(_HEADERS)
                if b"cache-control" not in given:
                    extra["Cache-Control"] = "no-store"
                message["headers"] += [
                    (name.lower().encode(), value.encode()) for name, value in extra.items()
                ]
            await send(message)

        await self.app(scope, receive, send_safe if scope["type"] == "http" else send)


class SimulatedAnswers(Protocol):
    """What simulated observers answer (`pourcast.observers.rehearsal`)."""

    def answers(self, observer: int, steps: Sequence[Step]) -> dict[str, Any]:
        """Responses and response times [s] of an observer (from 0), by the step's number."""
        ...


def create_app(
    experiment: LiveExperiment,
    *,
    rehearsal: SimulatedAnswers | None = None,
    extra: tuple[Route, ...] = (),
) -> Starlette:
    """The web application of an experiment.

    Parameters
    ----------
    experiment
        The experiment.
    rehearsal
        Answers of simulated observers; without it nobody can be simulated.
    extra
        More routes, such as the admin page's.

    Raises
    ------
    InputError
        If the page has not been built.
    """
    require_page()
    api = _Api(experiment, rehearsal)

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        saving = asyncio.create_task(experiment.keep_saving())
        try:
            yield
        finally:
            saving.cancel()

    app = Starlette(
        routes=[
            Route("/", api.page),
            Route("/api/sessions", api.begin, methods=["POST"]),
            Route("/api/session/resume", api.resume, methods=["POST"]),
            Route("/api/session/records/{seq}", api.save, methods=["PUT"]),
            Route("/api/session/finish", api.finish, methods=["POST"]),
            Route("/media/{name}", api.media),
            Mount("/assets", _Forever(directory=DIST / "assets")),
            *extra,
        ],
        middleware=[Middleware(SafeHeaders)],
        exception_handlers={
            HTTPException: _http_error,
            Refusal: _refusal,
            StoreError: _not_saved,
            ClientDisconnect: _cut_off,
            Exception: _failed,
        },
        lifespan=lifespan,
    )
    app.state.stop_texts = experiment.texts["stop"]
    # It would lead out of the path that a web server before this one serves it under.
    app.router.redirect_slashes = False
    return app


class _Forever(StaticFiles):
    """Files whose names change with their content."""

    def file_response(self, *args: Any, **kwargs: Any) -> Response:
        response = super().file_response(*args, **kwargs)
        response.headers["Cache-Control"] = "public, max-age=31536000, immutable"
        return response


class _Api:
    def __init__(self, experiment: LiveExperiment, rehearsal: SimulatedAnswers | None) -> None:
        self.experiment, self.rehearsal = experiment, rehearsal
        self._page = page_html(experiment.texts, experiment.design.language)

    async def page(self, _: Request) -> Response:
        """The participants' page."""
        return HTMLResponse(self._page)

    async def begin(self, request: Request) -> Response:
        """Begin a session, or go on with that of the same request or platform session."""
        content = await _parsed(request, _BeginContent)
        who = visitor(content.link, self.experiment.storage.secret)
        address = visitors_place(request.client.host) if request.client else ""
        if who is None and is_unaccepted(content.link):
            raise Refusal("unaccepted")
        if who is None and (missing := unfilled(content.link)):
            await self.experiment.refuse_unfilled(missing, address)
        if who is None or (who.entry == "simulation" and self.rehearsal is None):
            raise Refusal("link")
        session, token = await self.experiment.begin(who, content.request, content.tab, address)
        answer = await self._session_view(session)
        if who.entry == "simulation" and self.rehearsal is not None:
            observer = content.link.get("observer", "")
            answer["simulated"] = self.rehearsal.answers(
                int(observer) if re.fullmatch("[0-9]{1,4}", observer) else session.place,
                session.steps,
            )
        return JSONResponse(answer | {"token": token}, 201)

    async def resume(self, request: Request) -> Response:
        """Say what is saved of a session, and give it to the tab that asks for it."""
        content = await _parsed(request, _ResumeContent)
        session = await self.experiment.resume(_token(request), content.tab)
        return JSONResponse(await self._session_view(session))

    async def save(self, request: Request) -> Response:
        """Save a record. The answer is sent when the database has it on the disk."""
        token, step = _token(request), request.path_params["seq"]
        content = await _parsed(request, _RecordContent)
        try:
            if not re.fullmatch("[0-9]{1,9}", step):
                raise NoSuchStepError(step)
            result = await self.experiment.save(token, int(step), content.body, content.tab)
        except NoSuchStepError:
            raise HTTPException(404, "no such step") from None
        except ValidationError as error:
            raise HTTPException(422, _first(error)) from None
        return JSONResponse({"saved": result.status, "superseded": result.superseded})

    async def finish(self, request: Request) -> Response:
        """End a session, or name the steps that are missing.

        `state` is in the answer if the session's is another than was asked for: one that has ended
        stays as it is, and a tab that has not the session can only say that it is complete.
        """
        token = _token(request)
        content = await _parsed(request, _FinishContent)
        ending = await self.experiment.finish(token, content.state, content.tab)
        if ending is None and content.state == DECLINED:
            # Deleted before, and the browser never got the answer.
            return JSONResponse({"missing": [], "code": "", "redirect": ""})
        if ending is None:
            raise Refusal("gone")
        if ending.missing:
            return JSONResponse({"missing": ending.missing})
        state = ending.session.state
        other = {} if state == content.state else {"state": state}
        return JSONResponse({"missing": [], **other, **self._farewell(ending.session)})

    async def media(self, request: Request) -> Response:
        """A still, or a film of a practice trial."""
        path = self.experiment.materials.published.get(request.path_params["name"])
        if path is None or not path.is_file():
            raise HTTPException(404, "no such file")
        return FileResponse(path, headers={"Cache-Control": "private, max-age=86400, immutable"})

    async def _session_view(self, session: Session) -> dict[str, Any]:
        """What the browser must know of a session."""
        experiment = self.experiment
        view = participant_view(experiment.materials, experiment.texts) | {
            "key": session.key,
            "participant": session.participant,
            "entry": session.entry,
            "state": session.state,
            "code": session.code,
            "steps": [step.for_participant() for step in session.steps],
            "done": await experiment.saved_steps(session),
        }
        if session.state != OPEN:
            view |= self._farewell(session)
        return view

    def _farewell(self, session: Session) -> dict[str, str]:
        """Completion code and way back, when a session has ended."""
        recruiting = self.experiment.design.recruiting
        own = session.code if session.state == COMPLETE else ""
        code = recruiting.codes.get(session.state) or own
        if session.entry == "lab":
            return {"code": "", "redirect": ""}
        redirect = recruiting.redirect if code and session.entry != "preview" else ""
        return {"code": code, "redirect": redirect.replace("{code}", code)}


async def _parsed(request: Request, model: type[Model]) -> Model:
    """The request's JSON, checked; its size is limited while it comes in."""
    content = b""
    async for chunk in request.stream():
        content += chunk
        if len(content) > MAX_BODY:
            raise HTTPException(413, f"at most {MAX_BODY} bytes")
    try:
        return model.model_validate(json.loads(content))
    except (ValueError, RecursionError) as error:
        message = _first(error) if isinstance(error, ValidationError) else "not JSON"
        raise HTTPException(422, message) from None


def _first(error: ValidationError) -> str:
    first = error.errors()[0]
    return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"


def _token(request: Request) -> str:
    kind, _, token = request.headers.get("Authorization", "").partition(" ")
    if kind != "Bearer" or not re.fullmatch("[A-Za-z0-9_-]{20,100}", token):
        raise Refusal("gone")
    return token


async def _http_error(_: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return JSONResponse({"error": error.detail}, error.status_code, error.headers)


async def _refusal(request: Request, error: Exception) -> Response:
    assert isinstance(error, Refusal)
    text = request.app.state.stop_texts[error.reason]
    return JSONResponse({"refused": error.reason, "text": text}, _REFUSED[error.reason])


async def _not_saved(_: Request, __: Exception) -> Response:
    return JSONResponse({"error": "not saved; try again"}, 503, {"Retry-After": "2"})


async def _cut_off(_: Request, __: Exception) -> Response:
    return JSONResponse({"error": "the request was cut off"}, 400)


async def _failed(_: Request, __: Exception) -> Response:
    return JSONResponse({"error": "the server failed"}, 500)

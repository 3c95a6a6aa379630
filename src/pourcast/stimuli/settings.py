"""How stimuli are made: which solver, which renderer, and their settings."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import ConfigDict, Field, GetCoreSchemaHandler, ValidationError
from pydantic_core import core_schema

from pourcast.errors import InputError, one_line
from pourcast.frozen import Frozen
from pourcast.registry import Registry
from pourcast.scenes.liquids.base import Liquid
from pourcast.simulation.versions import code_version, defining_modules
from pourcast.stimuli.renderers.base import Renderer
from pourcast.stimuli.renderers.registry import RENDERERS
from pourcast.stimuli.solvers.base import Solver
from pourcast.stimuli.solvers.registry import SOLVERS

PREVIEW_RESOLUTION = 60
"""Cells of a quick look, along the box's longest side."""


class _ByName:
    """Validates a member of a registry, whose name stands under a key beside its settings."""

    def __init__(self, registry: Registry[Any], key: str) -> None:
        self.registry, self.key = registry, key

    def _validated(self, value: Any) -> Any:
        if isinstance(value, Solver | Renderer):
            return value
        if not isinstance(value, Mapping) or not isinstance(value.get(self.key), str):
            names = ", ".join(self.registry.names())
            raise ValueError(f"expected an object with the field {self.key!r}: {names}")
        settings = {name: setting for name, setting in value.items() if name != self.key}
        try:
            return self.registry.get(value[self.key]).model_validate(settings)
        except ValidationError as error:
            raise ValueError(one_line(error)) from None

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        dump = core_schema.plain_serializer_function_ser_schema(
            lambda member: {self.key: member.name, **member.model_dump(mode="json")}
        )
        return core_schema.no_info_plain_validator_function(self._validated, serialization=dump)


class StimulusSettings(Frozen):
    """How a set of stimuli is made; in a manifest, the set's `recipe`.

    Parameters
    ----------
    solver, renderer
        What pours and what draws, with their settings; `flow` and `look` in a manifest.
    seconds
        Length of films [s]; each liquid's own by default.
    webm
        Whether films are made as WebM, too.

    Examples
    --------
    >>> StimulusSettings(flow={"solver": "lbm"}, look={"renderer": "cycles"}).name
    'lbm-cycles'
    """

    model_config = ConfigDict(populate_by_name=True)

    solver: Annotated[Solver, _ByName(SOLVERS, "solver")] = Field(alias="flow")
    renderer: Annotated[Renderer, _ByName(RENDERERS, "renderer")] = Field(alias="look")
    seconds: float | None = Field(default=None, gt=0.0, le=120.0)
    webm: bool = False

    @property
    def name(self) -> str:
        """Name of the set: solver and renderer."""
        return f"{self.solver.name}-{self.renderer.name}"

    @property
    def solver_code(self) -> str:
        """Name of the state of the solver's code, which decides where liquid goes."""
        return code_version(defining_modules(type(self.solver), Solver))

    def film_seconds(self, liquid: Liquid) -> float:
        """Length of a liquid's films [s]."""
        return liquid.film_seconds if self.seconds is None else self.seconds

    def liquid_identity(self, liquid: Liquid) -> dict[str, Any]:
        """All of a liquid that its stimuli depend on, by the liquid's own names."""
        return {
            **self.solver.liquid_identity(liquid),
            **self.renderer.liquid_identity(liquid),
            "film_seconds": self.film_seconds(liquid),
        }

    def difference(self, other: "StimulusSettings") -> str:
        """The first setting in which another of the same name differs; empty if none does."""
        return first_difference(self._flat(), other._flat())

    def _flat(self) -> dict[str, Any]:
        parts = {**self.solver.model_dump(), **self.renderer.model_dump()}
        return parts | {"seconds": self.seconds, "webm": self.webm}


def first_difference(one: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    """The first name under which two tables differ, and how; empty if they don't."""
    for name in [*one, *other]:
        if one.get(name) != other.get(name):
            return f"{name} {one.get(name)}, not {other.get(name)}"
    return ""


def stimulus_settings(
    solver: str,
    renderer: str,
    *,
    size: tuple[int, ...] = (),
    seconds: float | None = None,
    webm: bool = False,
    options: Mapping[str, Any],
) -> StimulusSettings:
    """Settings as a user gives them.

    Parameters
    ----------
    solver, renderer
        Names.
    size
        Width, or width and height [pixels]; the renderer's own if it is empty.
    seconds
        Length of films [s].
    webm
        Whether films are made as WebM, too.
    options
        Further settings by name; those that are None are left out.

    Raises
    ------
    InputError
        One line that names what is wrong, also a setting that neither solver nor renderer has.

    Examples
    --------
    >>> stimulus_settings("sph", "preview", size=(80, 120), options={"samples": None}).renderer
    Preview(width=80)
    """
    members = SOLVERS.get(solver), RENDERERS.get(renderer)
    for name, value in options.items():
        if value is not None and not any(name in member.model_fields for member in members):
            raise InputError(
                f"{name.replace('_', '-')}: neither the solver {solver!r} nor the renderer "
                f"{renderer!r} has this setting"
            )
    given = {**options, **dict(zip(("width", "height"), size, strict=False))}

    def known(member: type[Solver | Renderer]) -> dict[str, Any]:
        names = [name for name in member.model_fields if given.get(name) is not None]
        return {name: given[name] for name in names}

    content = {
        "flow": {"solver": solver, **known(members[0])},
        "look": {"renderer": renderer, **known(members[1])},
        "seconds": seconds,
        "webm": webm,
    }
    try:
        return StimulusSettings.model_validate(content)
    except ValidationError as error:
        raise InputError(one_line(error)) from None

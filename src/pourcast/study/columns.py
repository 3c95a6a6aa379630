"""Which column of another program's table is what: said once, and kept beside the data.

A mapping is a TOML file, or a short text (`parse_columns`). `study.recode` reads a table by it.
"""

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationError, field_validator, model_validator

from pourcast.errors import InputError, one_line, unknown
from pourcast.frozen import Frozen
from pourcast.study.scale import Scale, scale_of

COLUMNS_FILE = "columns.toml"
"""The mapping of all tables of its folder; of one table alone, the file with its name and .toml."""

ANY = "*"
"""In a condition: whatever stands in the cell, but it isn't blank."""


class Source(Frozen):
    """Where a value comes from: a column, a constant, the file's name, or a wide table's header.

    Parameters
    ----------
    column
        Name of a column.
    value
        The same for all rows.
    file
        The file's name, without its extension.
    pattern
        Regular expression with one group, which is what is taken of the text; alone, of the
        header of a wide table.
    fill
        A blank cell has what stands above it.
    """

    column: str | None = None
    value: str | None = None
    file: bool = False
    pattern: str | None = None
    fill: bool = False

    @model_validator(mode="after")
    def _one_source(self) -> "Source":
        named = (self.column is not None) + (self.value is not None) + self.file
        if named > 1 or (not named and self.pattern is None):
            raise ValueError("expected one of `column`, `value`, `file`, and perhaps `pattern`")
        if self.fill and self.column is None:
            raise ValueError("`fill` goes with `column`")
        if self.value is not None and not self.value.strip():
            raise ValueError("value: expected a text")
        return self

    @field_validator("pattern")
    @classmethod
    def _one_group(cls, pattern: str | None) -> str | None:
        try:
            groups = 1 if pattern is None else re.compile(pattern).groups
        except re.error as error:
            raise ValueError(f"not a regular expression ({error})") from None
        if groups != 1:
            raise ValueError(f"expected a pattern with one group, found {groups}")
        return pattern

    @property
    def in_header(self) -> bool:
        """Whether it is taken from the header of a wide table."""
        return self.column is None and self.value is None and not self.file


def _named(given: Any) -> Any:
    """A text alone names a column."""
    if not isinstance(given, str | Mapping | Source):
        raise ValueError('expected a column\'s name, or such as { value = "..." }')
    return {"column": given} if isinstance(given, str) else given


def _texts(given: Any) -> Any:
    """One value or several, as cells have them."""
    values = given if isinstance(given, list | tuple) else [given]
    if not all(isinstance(value, str | int | float) for value in values):
        raise ValueError("expected a value, or a list of values")
    return tuple(plain_text(value) for value in values)


def plain_text(value: Any) -> str:
    """A value as text that can be compared: whole numbers without decimals, letters small.

    Examples
    --------
    >>> [plain_text(value) for value in (1, "1.0", True, " Slider ", None)]
    ['1', '1', 'true', 'slider', '']
    """
    text = "" if value is None or value != value else str(value).strip().casefold()  # noqa: PLR0124 (NaN)
    number = re.fullmatch(r"([-+]?\d+)\.0*", text)
    return number[1] if number else text


_Source = Annotated[Source, BeforeValidator(_named)]
_Texts = Annotated[tuple[str, ...], BeforeValidator(_texts)]
Condition = Mapping[str, tuple[str, ...]]
"""Column -> what may stand in it, as `plain_text`; all columns must agree."""

FIELDS = (
    "participant", "scene", "liquid", "response", "rt", "phase", "trial", "mirrored", "correct",
    "simulated", "answers",
)  # fmt: skip
"""Columns of a table of responses that a mapping can name; `answers`: how many a mean is of."""


class Columns(Frozen):
    """What a mapping says. A field that it doesn't name is the column of that name, if any is.

    Parameters
    ----------
    participant, scene, liquid, response, rt, phase, trial, mirrored, correct, simulated
        Where the columns of a table of responses come from. A scene's id is looked for in the text
        if there is no pattern.
    answers
        Means: where it stands how many answers each is of.
    rt_unit
        Of response times.
    scale
        Of responses, such as ``0-100``; 0 to 1 by default.
    missing
        What stands in place of a response, or a response time, that wasn't given, besides what
        always does (blank, NA, null, None).
    trials, practice
        Column -> what stands in it, in rows that are trials, and in those of practice (which are
        left out even if they are trials): a value, several, ``"*"`` (anything) or ``""`` (nothing).
    wide
        A row has a participant's responses to all scenes, each in a column that names the scene.
    means
        Responses are means; nothing is known of single participants.
    header_rows
        Further rows of the header below its first, as Qualtrics writes two.
    """

    participant: _Source | None = None
    scene: _Source | None = None
    liquid: _Source | None = None
    response: _Source | None = None
    rt: _Source | None = None
    phase: _Source | None = None
    trial: _Source | None = None
    mirrored: _Source | None = None
    correct: _Source | None = None
    simulated: _Source | None = None
    answers: _Source | None = None
    rt_unit: Literal["s", "ms"] = "s"
    scale: str | None = None
    missing: _Texts = ()
    trials: Mapping[str, _Texts] = Field(default_factory=dict)
    practice: Mapping[str, _Texts] = Field(default_factory=dict)
    wide: bool = False
    means: bool = False
    header_rows: int = Field(default=0, ge=0, le=100)

    @field_validator("scale")
    @classmethod
    def _readable(cls, scale: str | None) -> str | None:
        if scale is not None:
            scale_of(scale)
        return scale

    @model_validator(mode="after")
    def _fits_together(self) -> "Columns":
        sources = self.sources
        if self.wide and (wrong := {"response", "rt"} & set(sources)):
            raise ValueError(f"{min(wrong)}: a wide table has responses in the scenes' columns")
        if self.wide and self.scene is not None and not self.scene.in_header:
            raise ValueError("scene: of a wide table, expected a `pattern` alone")
        headers = [name for name, source in sources.items() if source.in_header]
        if headers and not self.wide:
            raise ValueError(f"{headers[0]}: a `pattern` alone goes with `wide = true`")
        if self.means and (self.wide or self.participant is not None):
            raise ValueError("means: they are of no participant, and a row each")
        if self.answers is not None and not self.means:
            raise ValueError("answers: goes with `means = true`")
        return self

    @property
    def sources(self) -> dict[str, Source]:
        """Fields that the mapping names, and where they come from."""
        named = {name: getattr(self, name) for name in FIELDS}
        return {name: source for name, source in named.items() if source is not None}

    @property
    def needed(self) -> dict[str, str]:
        """Columns of the file that must be there -> what for."""
        found = {
            source.column: name
            for name, source in self.sources.items()
            if source.column is not None
        }
        for name in ("trials", "practice"):
            found |= dict.fromkeys(getattr(self, name), name)
        return found

    def scale_or(self, given: Scale | None) -> Scale | None:
        """The scale that the mapping and the user say; None if neither does.

        Raises
        ------
        InputError
            If they say different ones.
        """
        own = None if self.scale is None else scale_of(self.scale)
        if own is not None and given not in (None, own):
            raise InputError(f"scale: --scale has another one than the mapping ({self.scale})")
        return given or own


def parse_columns(text: str) -> Columns:
    """A mapping as a short text: ``NAME=COLUMN`` or ``NAME:VALUE``, with commas between.

    Columns that have a comma in their name, and patterns, need a file.

    Raises
    ------
    InputError
        One line that names the field and what was expected.

    Examples
    --------
    >>> found = parse_columns("participant=PID,liquid:water,rt=RT,rt_unit:ms,trials.type:slider")
    >>> found.participant.column, found.liquid.value, found.trials
    ('PID', 'water', {'type': ('slider',)})
    """
    content: dict[str, Any] = {}
    for item in text.split(","):
        match = re.fullmatch(r"\s*(\w+)(?:\.([^=:]+))?\s*([=:])\s*(.*?)\s*", item)
        if match is None:
            raise InputError(
                f"columns: expected a .toml file, or NAME=COLUMN or NAME:VALUE with commas "
                f"between, found {item!r}"
            )
        name, column, sign, value = match.groups()
        if name not in Columns.model_fields:
            raise InputError(f"columns: {unknown(name, Columns.model_fields)}")
        if column is not None:
            content.setdefault(name, {})[column] = value
        elif name in FIELDS:
            content[name] = {"column" if sign == "=" else "value": value}
        else:
            content[name] = value
    return _checked(content, "columns")


def read_columns(path: Path) -> Columns:
    """A mapping from its TOML file.

    Raises
    ------
    InputError
        One line that names the file, the field and what was expected.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not TOML ({error})") from None
    return _checked(content, str(path))


def _checked(content: Mapping[str, Any], source: str) -> Columns:
    strange = [name for name in content if name not in Columns.model_fields]
    if strange:
        raise InputError(f"{source}: {unknown(strange[0], Columns.model_fields)}")
    try:
        return Columns.model_validate(content)
    except ValidationError as error:
        raise InputError(f"{source}: {one_line(error)}") from None


def _is_mapping(path: Path) -> bool:
    """Whether there is such a file, and it isn't a study's or a grid's, say, of the same name."""
    if not path.is_file():
        return False
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError):
        return True  # To be refused where it is read.
    return not content or any(name in Columns.model_fields for name in content)


def find_columns(given: str | None, data: Path) -> tuple[Columns, str]:
    """The mapping of a table, and where it was said; nothing is mapped if there is none.

    Parameters
    ----------
    given
        A .toml file, or a text for `parse_columns`; None for the file that lies beside the data,
        if there is one: ``NAME.toml`` beside ``NAME.csv``, or `COLUMNS_FILE` in the same folder.
    data
        A table, or a folder of tables.
    """
    if given is not None and not given.lower().endswith(".toml"):
        return parse_columns(given), given
    inside = data if data.is_dir() else data.parent
    beside = (data.with_suffix(".toml"), inside / COLUMNS_FILE)
    path = Path(given) if given is not None else next(filter(_is_mapping, beside), None)
    return (Columns(), "") if path is None else (read_columns(path), str(path))

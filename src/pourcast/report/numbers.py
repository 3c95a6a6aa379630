"""Numbers that a reader must know to repeat pours and choices of scenes, in words."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pourcast.simulation.pour import Pour
from pourcast.simulation.settings import EngineSettings
from pourcast.study.chosen import HowChosen


def fields_in_words(fields: Mapping[str, Any]) -> str:
    """Names and values as they are in the code, so that they can be set again.

    Examples
    --------
    >>> fields_in_words({"step": 0.0004, "viscous_pairs": "approaching"})
    'step = 0.0004; viscous_pairs = approaching'
    """
    return "; ".join(f"{name} = {_value(value)}" for name, value in fields.items())


def liquid_in_words(numbers: Mapping[str, float]) -> str:
    """What a liquid is like in the particle engine; from `Liquid.engine_identity`.

    Examples
    --------
    >>> liquid_in_words({"viscosity_alpha": 2.0, "cohesion": 0.02})
    'alpha = 2, cohesion 0.02 m³/s², no adhesion'
    """
    cohesion = numbers.get("cohesion", 0.0)
    normal, along = (numbers.get(f"adhesion_{way}", 0.0) for way in ("normal", "tangential"))
    words = [
        f"alpha = {numbers['viscosity_alpha']:g}",
        f"cohesion {cohesion:g} m³/s²" if cohesion else "no cohesion",
        f"adhesion {normal:g} 1/s normal and {along:g} 1/s tangential"
        if normal or along
        else "no adhesion",
    ]
    if tension := numbers.get("tension", 0.0):
        words.append(f"tension {tension:g}")
    return ", ".join(words)


def engine_in_words(engine: EngineSettings, pours: Sequence[Pour]) -> str:
    """How pours were computed, as far as these pours depend on what the paper leaves open."""
    kinds = {pour.kind for pour in pours}
    words = [f"the acceleration is lowered by {engine.damping_scale:g} zeta times the velocity"]
    if zeta := max(pour.damping_zeta for pour in pours):
        words[0] += f" (zeta = {zeta:g}/s damps at {engine.damping_scale * zeta:g}/s)"
    if "liquid" in kinds:
        words += [
            "particles of a liquid meet solids as spheres with a radius of "
            f"{engine.contact_radius:g} particle spacings, and stick, if the liquid is sticky, up "
            f"to {engine.contact_layer:g} of that radius away",
        ]
    if "marbles" in kinds:
        words += [f"marbles have a radius of {engine.marble_radius:g} particle spacings"]
    return f"In the particle engine, {'; '.join(words)}."


def how_drawn(chosen: HowChosen) -> list[tuple[str, str]]:
    """What a study's scenes were drawn from, and what was poured to choose among them.

    Parameters
    ----------
    chosen
        From the study's `chosen.json`; of an older one, what it has.

    Returns
    -------
    list
        Rows of two cells: what it is, and the numbers, in words.
    """
    family = dict(chosen.family)
    name = family.pop("name", "")
    rows = [
        ("drawn by", f"pourcast {chosen.pourcast}"),
        (f"statistics of the draws{name and f' ({name})'}, in SI units", _spoken(family)),
    ]
    if chosen.pours:
        liquids = {one["liquid"]: liquid_in_words(one) for one in chosen.pours}
        rows += [
            ("poured into each", "; ".join(_poured(chosen.pours))),
            ("liquids", "; ".join(f"{liquid}: {words}" for liquid, words in liquids.items())),
        ]
    if chosen.engine:
        rows.append(("engine settings", fields_in_words(chosen.engine)))
    return rows


def _poured(pours: Iterable[Mapping[str, Any]]) -> list[str]:
    """Pours in words, those together that differ only in damping."""
    dampings: dict[str, list[str]] = {}
    for one in pours:
        what = "marbles" if one["kind"] == "marbles" else f"particles of {one['liquid']}"
        moved = f", moved by {_value(one['offset'])} m" if any(one["offset"]) else ""
        words = f"{one['n_particles']} {what}{moved}"
        dampings.setdefault(words, []).append(f"{one['damping_zeta']:g}")
    return [f"{words}, zeta = {', '.join(zetas)}/s" for words, zetas in dampings.items()]


def _spoken(fields: Mapping[str, Any]) -> str:
    return "; ".join(f"{name.replace('_', ' ')} {_value(value)}" for name, value in fields.items())


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return f"({_spoken(value)})"
    if isinstance(value, list | tuple):
        return f"({', '.join(_value(one) for one in value)})"
    return f"{value:g}" if isinstance(value, float) else str(value)

"""How much work a pour is, on the two cores that the constants were measured on.

The figures only size the pieces of work, and spread a calibration over what was
not measured (`sweep.estimate`); no result depends on them.
"""

import numpy as np

from pourcast.scenes.liquids.base import Liquid
from pourcast.simulation.settings import EngineSettings, Kind

_LIQUID_STEP_MS = {
    15: 0.00023, 25: 0.0004, 50: 0.00115, 100: 0.0035, 200: 0.0085, 300: 0.014,
    1000: 0.065, 2000: 0.165,
}  # fmt: skip
_MARBLE_STEP_MS = {15: 0.0006, 25: 0.00097, 50: 0.0025, 100: 0.0072, 200: 0.023, 300: 0.05}
"""Milliseconds of one core for a step of one simulation among many, by the number of
particles (`docs/explanation/speed.md`)."""


def simulated_seconds(liquid: Liquid, n_particles: int, damping_zeta: float) -> float:
    """Simulated time until a pour is over [s], roughly: 120 scenes of Experiment 1.

    A damped liquid falls slower; an undamped one splashes, the longer the more
    particles there are; a sticky one creeps.
    """
    cap = EngineSettings().max_duration
    if liquid.adhesion_tangential > 0.0:
        return min(6.6 + 0.13 * damping_zeta, cap)
    splash = (1.0 + min(0.02 * n_particles, 2.5)) / (1.0 + damping_zeta)
    return min(1.2 + 0.16 * damping_zeta + splash, cap)


def pour_seconds(
    kind: Kind,
    liquid: Liquid,
    n_particles: int,
    damping_zeta: float,
    spacing: float,
    engine: EngineSettings | None = None,
) -> float:
    """Time of a pour on one core [s], roughly.

    Parameters
    ----------
    kind
        SPH liquid or rigid marbles.
    liquid, n_particles, damping_zeta
        As for `Pour`.
    spacing
        Particle spacing [m], on which the time step depends.
    engine
        How it is computed; by default with the settings as they come.
    """
    table = _LIQUID_STEP_MS if kind == "liquid" else _MARBLE_STEP_MS
    counts, times = np.log([*table]), np.log([*table.values()])
    step_seconds = 1e-3 * float(np.exp(np.interp(np.log(n_particles), counts, times)))
    stepping = (engine or EngineSettings()).stepping(kind, spacing, liquid.viscosity_alpha)
    steps = simulated_seconds(liquid, n_particles, damping_zeta) / stepping.step
    return steps * step_seconds

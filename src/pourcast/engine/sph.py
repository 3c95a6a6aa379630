"""Weakly compressible SPH of simulations in lockstep, composed of its chapters.

Monaghan (1992), Annu. Rev. Astron. Astrophys. 30: `smoothing` (kernel W),
`density`, `equation_of_state` (pressure), `viscosity`, `walls` (mirror images),
`momentum` (forces), `pairs` (which are near), `integrator`, `contact` (solids).
Densities are divided by rho0 throughout, so that masses cancel.
"""

from typing import Any

from pourcast.engine.compile import kernel
from pourcast.engine.contact import collide_with_box, collide_with_polygons
from pourcast.engine.density import add_pair_density, divide_by_rest_density, start_density
from pourcast.engine.integrator import integrate
from pourcast.engine.momentum import add_pair_forces, start_forces
from pourcast.engine.pairs import have_moved, list_pairs


@kernel
def find_density(state: Any, parameters: Any, pairs: Any) -> None:
    """Density of simulations in lockstep, over that at rest; lists their pairs anew."""
    list_pairs(state, parameters, pairs)
    _sum_density(state, parameters, pairs)


@kernel
def _sum_density(state: Any, parameters: Any, pairs: Any) -> None:
    start_density(state, parameters)
    add_pair_density(state, parameters, pairs)
    divide_by_rest_density(state, parameters)


@kernel
def find_forces(state: Any, parameters: Any, pairs: Any) -> None:
    """Density, pressure and forces of simulations in lockstep, by the pairs listed."""
    _sum_density(state, parameters, pairs)
    start_forces(state, parameters)
    add_pair_forces(state, parameters, pairs)


@kernel
def advance(
    state: Any,
    parameters: Any,
    solids: Any,
    broad_phase: Any,
    step: float,
    steps: int,
    pairs: Any,
) -> None:
    """Move simulations in lockstep on by a number of steps.

    Parameters
    ----------
    state
        The particles; changed in place.
    parameters
        Parameters of the lanes.
    solids, broad_phase
        Polygons and broad phase (`contact`).
    step
        Time step [s].
    steps
        How many.
    pairs
        Room for their pairs, which are listed anew.
    """
    rows = state.density.shape[0]
    list_pairs(state, parameters, pairs)
    for _ in range(steps):
        if have_moved(state, parameters, pairs):
            list_pairs(state, parameters, pairs)
        find_forces(state, parameters, pairs)
        integrate(state, parameters, step, 0, rows)
        collide_with_box(state, parameters, 0, rows)
        collide_with_polygons(state, parameters, solids, broad_phase, 0, rows)

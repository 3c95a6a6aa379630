"""Weakly compressible SPH of 16 simulations in lockstep, composed of its chapters.

Monaghan (1992), Annu. Rev. Astron. Astrophys. 30: `smoothing` (kernel W),
`density`, `equation_of_state` (pressure), `viscosity`, `walls` (mirror images),
`momentum` (forces), `integrator`, `contact` (solids). Densities are divided by
rho0 throughout, so that masses cancel.
"""

from typing import Any

from pourcast.engine.compile import kernel
from pourcast.engine.contact import collide_with_box, collide_with_polygons
from pourcast.engine.density import add_pair_density, divide_by_rest_density, start_density
from pourcast.engine.integrator import integrate
from pourcast.engine.momentum import add_pair_forces, start_forces


@kernel
def find_density(state: Any, lanes: Any) -> None:
    """Density of 16 simulations in lockstep, over that at rest."""
    start_density(state, lanes)
    add_pair_density(state, lanes)
    divide_by_rest_density(state, lanes)


@kernel
def find_forces(state: Any, lanes: Any) -> None:
    """Density, pressure and forces of 16 simulations in lockstep."""
    find_density(state, lanes)
    start_forces(state, lanes)
    add_pair_forces(state, lanes)


@kernel
def advance(state: Any, lanes: Any, solids: Any, cells: Any, step: float, steps: int) -> None:
    """Move 16 simulations on by a number of steps.

    Parameters
    ----------
    state
        The particles; changed in place.
    lanes
        Parameters of the lanes.
    solids, cells
        Polygons and broad phase (`contact`).
    step
        Time step [s].
    steps
        How many.
    """
    for _ in range(steps):
        find_forces(state, lanes)
        integrate(state, lanes, step)
        collide_with_box(state, lanes)
        collide_with_polygons(state, lanes, solids, cells)

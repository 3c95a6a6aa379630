"""The lattice D3Q19: which way populations move, and how much of a liquid at rest each one is.

From Qian, d'Humieres & Lallemand (1992), "Lattice BGK models for Navier-Stokes equation",
Europhys. Lett. 17. In lattice units a cell is 1 wide, a step takes 1, and the speed of sound
is 1 / sqrt(3).
"""

import numpy as np

N_DIRECTIONS = 19

VELOCITY = np.array(
    [
        (0, 0, 0),
        (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1),
        (1, 1, 0), (-1, -1, 0), (1, -1, 0), (-1, 1, 0),
        (1, 0, 1), (-1, 0, -1), (1, 0, -1), (-1, 0, 1),
        (0, 1, 1), (0, -1, -1), (0, 1, -1), (0, -1, 1),
    ],
    dtype=np.int64,
)  # fmt: skip
"""Velocities [cells per step], shape [19, 3]; each pair of opposite ones side by side."""

WEIGHT = np.array([1 / 3] + 6 * [1 / 18] + 12 * [1 / 36])
"""Share of each population in a liquid at rest."""

OPPOSITE = np.array([0] + [k + 1 if k % 2 else k - 1 for k in range(1, N_DIRECTIONS)])
"""Direction that points the other way."""

MIRRORED = np.array(
    [
        [int(np.flatnonzero((velocity * flip == VELOCITY).all(axis=1))[0]) for velocity in VELOCITY]
        for flip in (1 - 2 * np.eye(3, dtype=np.int64))
    ]
)
"""Direction that each becomes in a wall across an axis, shape [3, 19]."""

FLATTENED = np.array(
    [
        [int(np.flatnonzero((velocity * keep == VELOCITY).all(axis=1))[0]) for velocity in VELOCITY]
        for keep in (1 - np.eye(3, dtype=np.int64))
    ]
)
"""Direction that each becomes without its part along an axis, shape [3, 19]."""

QUADRATIC = VELOCITY[:, :, None] * VELOCITY[:, None, :] - np.eye(3) / 3.0
"""c c - I / 3 of each direction, shape [19, 3, 3]."""

GAS, INTERFACE, FLUID, SOLID = range(4)
"""What a cell is: without liquid; at its surface, partly filled; full; or no place for it."""

STANDARD, NO_FLUID, NO_GAS = range(3)
"""What an interface cell touches: both sides, no full cell, no empty cell (Thuerey 2007, 4.2)."""

"""Experiment 2: three shapes in the air, a cup on the floor.

Bates et al., Experiment 2: three obstacles, each an equilateral triangle, a
square or a circle of random size and place; the cup is a third of the scene
wide and stands at one of five evenly spaced places.
"""

from dataclasses import dataclass

import numpy as np
import shapely

from pourcast.scenes.geometry import Polygon
from pourcast.scenes.goals.cup import Cup
from pourcast.scenes.polygons import DECIMALS
from pourcast.scenes.scene import Box, LiquidStart, Scene

CIRCLE_SIDES = 32
"""A circle is a polygon of this many sides by the time physics sees it."""

CUP_PLACES = 5

_TRIES = 100


@dataclass(frozen=True)
class ShapesFamily:
    """Statistics of Experiment 2's scenes.

    Parameters
    ----------
    shape_count
        Obstacles in a scene (paper: 3).
    min_radius, max_radius
        Range of the shapes' circumscribed radius [m].
    band_bottom, band_top
        Heights between which their centres lie [m].
    gap
        Least distance between two shapes [m]; twice the spacing of coarse
        particles lets liquid pass.
    liquid_y
        Height of the liquid's centre [m].
    liquid_spread
        The liquid's centre is drawn uniformly within this distance of the middle [m].
    """

    shape_count: int = 3
    min_radius: float = 0.08
    max_radius: float = 0.16
    band_bottom: float = 0.45
    band_top: float = 1.12
    gap: float = 0.05
    liquid_y: float = 1.38
    liquid_spread: float = 0.25
    name: str = "exp2"

    def draw(self, rng: np.random.Generator, scene_id: str) -> Scene | None:
        """Draw a scene.

        Parameters
        ----------
        rng
            Source of randomness.
        scene_id
            Its name.

        Returns
        -------
        Scene or None
            None if no room was found for all the shapes.
        """
        box = Box()
        liquid_x = box.width / 2 + rng.uniform(-self.liquid_spread, self.liquid_spread)
        liquid = LiquidStart(centre=(round(liquid_x, DECIMALS), self.liquid_y))
        place = rng.integers(CUP_PLACES)
        half = box.width / 6
        centre = half + place * (box.width - 2 * half) / (CUP_PLACES - 1)
        obstacles: list[Polygon] = []
        taken = [shapely.Point(liquid.centre).buffer(liquid.diameter / 2)]
        inside = shapely.box(0.0, 0.0, box.width, box.height)
        for _ in range(_TRIES):
            outline = self._shape(rng, box.width)
            shape = shapely.Polygon(outline)
            if inside.covers(shape) and all(shape.distance(other) >= self.gap for other in taken):
                obstacles.append(outline)
                taken.append(shape)
            if len(obstacles) == self.shape_count:
                break
        else:
            return None
        return Scene(
            id=scene_id,
            box=box,
            obstacles=tuple(obstacles),
            liquid=liquid,
            goal=Cup(centre_x=round(centre, DECIMALS), width=round(2 * half, DECIMALS)),
        )

    def _shape(self, rng: np.random.Generator, width: float) -> Polygon:
        sides = (3, 4, CIRCLE_SIDES)[rng.integers(3)]
        radius = rng.uniform(self.min_radius, self.max_radius)
        x = rng.uniform(0.0, width)
        y = rng.uniform(self.band_bottom, self.band_top)
        angles = rng.uniform(0.0, 2 * np.pi) + 2 * np.pi * np.arange(sides) / sides
        return tuple(
            (
                round(float(x + radius * np.cos(a)), DECIMALS),
                round(float(y + radius * np.sin(a)), DECIMALS),
            )
            for a in angles
        )

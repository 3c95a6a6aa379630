"""A liquid between water and honey."""

from pourcast import Liquid

OIL = Liquid(
    name="oil",
    viscosity_alpha=0.4,
    adhesion_normal=10.0,
    adhesion_tangential=10.0,
    kinematic_viscosity=5e-5,
    colour="#b8a11f",
    film_seconds=5.0,
)

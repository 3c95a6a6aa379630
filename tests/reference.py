"""The liquid once more: plain NumPy in float64, all pairs, no lists, no lanes. An oracle, and slow."""

import numpy as np

from pourcast.engine.cohesion import cohesion_factor
from pourcast.engine.contact import MIN_CLEARANCE
from pourcast.engine.packing import pack_cylinder, reference_density
from pourcast.simulation.pour import GRAVITY, Pour
from pourcast.simulation.settings import EngineSettings

PASSES, NOTICED = 4, 1e-3


def run(pour: Pour, duration: float, settings: EngineSettings) -> np.ndarray:
    """Positions [m] of a pour's particles after `duration`, shape [n_particles, 3]."""
    scene, liquid, count = pour.scene, pour.liquid, pour.n_particles
    start, depth = scene.liquid, settings.depth_in(scene, count)
    spacing = settings.spacing_in(scene, count)
    support = settings.support_in_spacings * spacing
    place = pack_cylinder(count, start.centre, start.diameter / 2, depth)
    origin = pack_cylinder(count, (0.0, 0.0), start.diameter / 2, depth)
    rest = reference_density(origin, support, depth)
    stepping = settings.stepping("liquid", spacing, liquid.viscosity_alpha)
    position, velocity = place.astype(float), np.zeros((pour.n_particles, 3))
    for _ in range(round(duration / stepping.step)):
        rate = accelerations(position, velocity, pour, support, rest, settings)
        rate -= settings.damping_scale * pour.damping_zeta * velocity
        rate[:, 1] -= GRAVITY
        previous = position.copy()
        velocity += stepping.step * rate
        position += stepping.step * velocity
        meet_box(position, velocity, pour, stepping.step, settings)
        meet_polygons(position, velocity, previous, pour, stepping.step, settings)
    return position


def accelerations(position, velocity, pour, support, rest, settings):
    """Pressure and artificial viscosity, mirror images in the walls included."""
    box, h, sound_speed = pour.scene.box, support / 2, settings.sound_speed
    depth = settings.depth_in(pour.scene, pour.n_particles)
    r = position[:, None] - position[None]
    squared = (r**2).sum(axis=2)
    near = np.maximum(1 - np.sqrt(squared) / support, 0)
    low, high = position, np.array([box.width, np.inf, depth]) - position
    gap = np.minimum(low, high)
    wall = np.maximum(1 - 2 * gap / support, 0)
    density = (shape(near).sum(axis=1) + shape(wall).sum(axis=1)) / rest
    pressure = np.maximum(density - 1, -pour.liquid.tension) / density**2
    factor = 20 / (support**2 * rest)
    v = velocity[:, None] - velocity[None]
    approach = (v * r).sum(axis=2)
    if settings.viscous_pairs == "approaching":
        approach = np.minimum(approach, 0)
    viscosity = 2 * pour.liquid.viscosity_alpha * sound_speed * h * approach
    viscosity /= (squared + 0.01 * h**2) * (density[:, None] + density[None])
    neutral = (1 - 1 / settings.support_in_spacings) ** 3
    cohesion = cohesion_factor(
        pour.liquid.cohesion, support / settings.support_in_spacings, support
    ) * (near**3 - neutral)
    push = factor * (sound_speed**2 * (pressure[:, None] + pressure[None]) - viscosity) * near**3
    push += cohesion * near**3
    inward = np.where(high < low, -1, 1)
    walls = 4 * factor * sound_speed**2 * pressure[:, None] * gap * wall**3 * inward
    return (push[:, :, None] * r).sum(axis=1) + walls


def shape(near):
    """Wendland C2 without its normalisation."""
    return near**4 * (5 - 4 * near)


def meet_box(position, velocity, pour, step, settings):
    """Walls, floor and panes: no speed into them; walls and floor are sticky."""
    box, count = pour.scene.box, pour.n_particles
    radius = settings.contact_radius_in(pour.scene, count, pour.kind)
    touch = radius * (1 + settings.contact_layer)
    normal, tangential = stickiness(pour, step)
    top = np.array([box.width, np.inf, settings.depth_in(pour.scene, count)]) - radius
    velocity[:] = np.where(position < radius, np.maximum(velocity, 0), velocity)
    velocity[:] = np.where(position > top, np.minimum(velocity, 0), velocity)
    side = np.minimum(position[:, 0], box.width - position[:, 0]) < touch
    floor = position[:, 1] < touch
    velocity[side] *= [normal, tangential, tangential]
    velocity[floor] *= [tangential, normal, tangential]
    position[:] = np.clip(position, radius, top)


def meet_polygons(position, velocity, previous, pour, step, settings):
    """Inelastic, sticky contact, one polygon after the other, until nothing moves."""
    scene = pour.scene
    radius = settings.contact_radius_in(scene, pour.n_particles, pour.kind)
    normal, tangential = stickiness(pour, step)
    active = np.ones(len(position), bool)
    for attempt in range(PASSES):
        deepest = np.zeros(len(position))
        for polygon in scene.solids:
            distance, out = gap_from(position[:, :2], np.array(polygon))
            depth = np.where(active, np.maximum(radius - distance, 0), 0)
            deepest = np.maximum(deepest, depth)
            position[:, :2] += depth[:, None] * out
            along = np.stack([-out[:, 1], out[:, 0]], axis=1)
            speed_out = (velocity[:, :2] * out).sum(axis=1)
            speed_along = (velocity[:, :2] * along).sum(axis=1)
            speed_out = np.where(depth > 0, np.maximum(speed_out, 0), speed_out)
            if attempt == 0:
                sticks = distance < radius * (1 + settings.contact_layer)
                speed_out = np.where(sticks, normal * speed_out, speed_out)
                speed_along = np.where(sticks, tangential * speed_along, speed_along)
                velocity[:, 2] *= np.where(sticks, tangential, 1)
            velocity[:, :2] = speed_out[:, None] * out + speed_along[:, None] * along
        position[:, 0] = np.clip(position[:, 0], radius, scene.box.width - radius)
        position[:, 1] = np.maximum(position[:, 1], radius)
        active &= deepest > NOTICED * radius
        if not active.any():
            return
    gaps = [gap_from(position[:, :2], np.array(polygon))[0] for polygon in scene.solids]
    stuck = active & (np.min(gaps, axis=0) < MIN_CLEARANCE)
    position[stuck, :2] = previous[stuck, :2]
    velocity[stuck] = 0


def gap_from(points, polygon):
    """Signed distances of points from a convex polygon, and unit vectors out of it."""
    edge = np.roll(polygon, -1, axis=0) - polygon
    length = np.hypot(*edge.T)
    tangent = edge / length[:, None]
    start = points[:, None] - polygon
    height = start[:, :, 0] * tangent[:, 1] - start[:, :, 1] * tangent[:, 0]
    along = np.clip((start * tangent).sum(axis=2), 0, length)
    gaps = start - along[:, :, None] * tangent
    squared = (gaps**2).sum(axis=2)
    nearest = np.argmin(squared, axis=1)
    row = np.arange(len(points))
    side = np.where(height.max(axis=1) > 0, 1, -1)
    distance = np.sqrt(squared[row, nearest])
    return side * distance, gaps[row, nearest] * (side / np.maximum(distance, 1e-9))[:, None]


def stickiness(pour, step):
    """Shares of normal and tangential speed that adhesion leaves in one step."""
    return np.exp(-pour.liquid.adhesion_normal * step), np.exp(
        -pour.liquid.adhesion_tangential * step
    )

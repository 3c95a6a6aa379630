"""Lists of near solids: complete for as long as they say, however crowded the place."""

import numpy as np
import pytest
import shapely

from pourcast.engine.contact import LIST_SKIN, collide_with_polygons, list_near
from pourcast.engine.polygons import pack_solids
from pourcast.engine.solids import BroadPhase, build_broad_phase, signed_distance
from pourcast.engine.state import NEAR_EDGES, NEAR_POLYGONS
from tests.make import job, loaded_block, random_scenes

RADIUS = 0.0185
LAYER = 0.1 * RADIUS
TOUCH = RADIUS + LAYER


def regular(sides, x, y, radius):
    angles = 2 * np.pi * np.arange(sides) / sides
    return np.stack([x + radius * np.cos(angles), y + radius * np.sin(angles)], axis=1)


def fan(blades, x, y):
    """Thin triangles whose tips nearly meet: more neighbours than a list has room for."""
    turns = 2 * np.pi * np.arange(blades) / blades
    tips = [np.array([[0.004, 0.0], [0.2, -0.02], [0.2, 0.02]]) for _ in turns]
    return [
        tip @ np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]) + (x, y)
        for tip, a in zip(tips, turns, strict=True)
    ]


def crowds():
    """Polygons of several scenes, from easy to nasty."""
    yield [np.array(p) for p in random_scenes(1, seed=3)[0].solids]
    yield [regular(32, 0.5, 0.7, 0.08), regular(200, 0.3, 0.7, 0.1)]
    yield fan(9, 0.5, 0.7)
    yield [np.array([[0.4, 0.6], [0.6, 0.6], [0.6, 0.60001], [0.5, 0.7], [0.49999, 0.7]])]


def listed_distances(state, lane, x, y):
    """Signed distances from the polygons in a list, in plain NumPy."""
    found = []
    for slot in range(int(state.near_count[0, lane])):
        edges = state.near_edges[slot * NEAR_EDGES : (slot + 1) * NEAR_EDGES, :, 0, lane]
        shapes = [
            shapely.LineString([(ex, ey), (ex - ny * length, ey + nx * length)])
            for ex, ey, nx, ny, length in edges.astype(float)
        ]
        outside = max((x - e[0]) * e[2] + (y - e[1]) * e[3] for e in edges.astype(float)) > 0
        distance = min(shape.distance(shapely.Point(x, y)) for shape in shapes)
        found.append(distance if outside else -distance)
    return sorted(found)


@pytest.mark.parametrize("polygons", list(crowds()), ids=["scene", "round", "fan", "needle"])
def test_a_list_holds_all_that_is_near_until_its_slack_is_used_up(polygons):
    rng = np.random.default_rng(5)
    solids = pack_solids([[(p, False) for p in polygons]])
    reach = TOUCH + LIST_SKIN * RADIUS
    cells = BroadPhase(*build_broad_phase(solids, np.array([[1.0, 1.5]]), reach, 0, 1))
    state, lanes = loaded_block([job(np.array([[0.5, 0.7, 0.07]]))], 1e-4)
    shapes = [shapely.Polygon(p) for p in polygons]
    compared = near = 0
    for _ in range(1500):
        x, y = rng.uniform((0.2, 0.5), (0.8, 0.9))
        if any(shape.covers(shapely.Point(x, y)) for shape in shapes):
            continue
        state.position[:2, 0, 0] = x, y
        list_near(state, lanes, solids, cells, 0, 0)
        slack = min(np.sqrt(state.squared_slack[0, 0]), 0.5)
        move = rng.uniform(0, slack) * np.exp(1j * rng.uniform(0, 2 * np.pi))
        x, y = x + move.real, y + move.imag
        if any(shape.covers(shapely.Point(x, y)) for shape in shapes):
            continue
        true = sorted(shape.distance(shapely.Point(x, y)) for shape in shapes)
        here = [d for d in true if d < TOUCH][:NEAR_POLYGONS]
        listed = listed_distances(state, 0, x, y)
        assert listed[: len(here)] == pytest.approx(here, abs=2e-6)
        assert not any(d < TOUCH - 2e-6 for d in listed[len(here) :])
        compared += 1
        near += bool(here)
    assert compared > 500
    assert near > 40


def test_distances_have_the_sign_of_the_inside():
    rng = np.random.default_rng(6)
    for polygons in crowds():
        solids = pack_solids([[(p, False) for p in polygons]])
        for k, polygon in enumerate(polygons):
            shape = shapely.Polygon(polygon)
            low_x, low_y, high_x, high_y = shape.buffer(0.05).bounds
            for x, y in rng.uniform((low_x, low_y), (high_x, high_y), (100, 2)):
                point = shapely.Point(x, y)
                exact = shape.exterior.distance(point) * (-1 if shape.covers(point) else 1)
                assert signed_distance(x, y, k, solids) == pytest.approx(exact, abs=1e-9)


def test_a_sphere_between_two_solids_that_leave_no_room_stays_where_it_was():
    walls = [
        np.array([[0.3, 0.5], [0.49, 0.5], [0.49, 0.9], [0.3, 0.9]]),
        np.array([[0.51, 0.5], [0.7, 0.5], [0.7, 0.9], [0.51, 0.9]]),
    ]
    solids = pack_solids([[(p, False) for p in walls]])
    cells = BroadPhase(*build_broad_phase(solids, np.array([[1.0, 1.5]]), 3 * RADIUS, 0, 1))
    inside = job(np.array([[0.4895, 0.7, 0.07]]), radius=RADIUS)
    state, lanes = loaded_block([inside], 1e-4)
    state.position[:2, 0, 0] = 0.4895, 0.7
    state.previous[:, 0, 0] = 0.5, 0.701
    state.velocity[:, 0, 0] = -1.0, -1.0, 0.5
    collide_with_polygons(state, lanes, solids, cells, 0, len(state.density))
    x, y = state.position[:2, 0, 0]
    assert 0.49 < x < 0.51
    assert state.touched[0, 0] == 1.0
    assert state.velocity[0, 0, 0] >= 0.0
    assert abs(y - 0.7) < 0.0011

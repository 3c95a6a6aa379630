"""SimpleSim once more: plain loops, one point at a time. An oracle, and slow."""

import math

import numpy as np

from pourcast.engine.polygons import pack_solids

TOUCH, INSIDE, ON_TOP, PROBE = 1e-9, 1e-6, 1e-5, 3e-6


def paths(model, scene, seed, m):
    """Corners [m] of each point's path with a momentum m [m]."""
    parts = [(np.array(p), k >= len(scene.obstacles)) for k, p in enumerate(scene.solids)]
    packed = pack_solids([parts])
    solids = packed._replace(**{name: column.tolist() for name, column in packed._asdict().items()})
    rng = np.random.default_rng([seed, int(scene.digest, 16)])
    chances = rng.random((model.n_points, len(scene.solids))).tolist()
    radius, (centre_x, y) = scene.liquid.diameter / 2, scene.liquid.centre
    across = (np.arange(model.n_points) + 0.5) / model.n_points
    starts = (centre_x + radius * (2 * across - 1)).tolist()
    return [
        walk(x, y, model.g, m, chance, solids, scene.box.width)
        for x, chance in zip(starts, chances, strict=True)
    ]


def first_hit(x0, y0, x1, y1, skip, solids):
    """Where a straight path first enters a solid."""
    length = math.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2)
    best, which = 1.0, -1
    for polygon in range(len(solids.polygon_start) - 1):
        if polygon == skip:
            continue
        enter, leave = -math.inf, math.inf
        for k in range(solids.polygon_start[polygon], solids.polygon_start[polygon + 1]):
            normal_x, normal_y = solids.normals[k][0], solids.normals[k][1]
            before = (x0 - solids.vertices[k][0]) * normal_x
            before += (y0 - solids.vertices[k][1]) * normal_y - TOUCH
            change = (x1 - x0) * normal_x + (y1 - y0) * normal_y
            if abs(change) < 1e-14:
                if before >= 0.0:
                    leave = -math.inf
            elif change < 0.0:
                enter = max(enter, -before / change)
            else:
                leave = min(leave, -before / change)
        start, end = max(enter, 0.0), min(leave, 1.0)
        if (end - start) * length > INSIDE and start < best:
            best, which = start, polygon
    return best, which


def top_of(polygon, x, solids):
    """Height of a polygon's upper surface at x [m], and the edge there (-1 beside it)."""
    for k in range(solids.polygon_start[polygon], solids.polygon_start[polygon + 1]):
        if solids.normals[k][1] <= 1e-12:
            continue
        # Counter-clockwise, an upper edge runs from right to left.
        right, left = (
            solids.vertices[k][0],
            solids.vertices[k][0] - (solids.lengths[k] * solids.normals[k][1]),
        )
        if left - 1e-12 <= x <= right + 1e-12:
            fall = solids.normals[k][0] / solids.normals[k][1]
            return solids.vertices[k][1] - (x - right) * fall, k
    return -math.inf, -1


def direction_on(polygon, x, g, chance, solids):
    """Way to set off on a polygon's surface: 1 to the right, -1 to the left."""
    _, edge = top_of(polygon, x, solids)
    downhill = 0
    if edge >= 0 and abs(solids.normals[edge][0]) > 1e-9:
        downhill = 1 if solids.normals[edge][0] > 0.0 else -1
    else:
        first, last = solids.polygon_start[polygon], solids.polygon_start[polygon + 1]
        left, right = math.inf, -math.inf
        for k in range(first, last):
            left = min(left, solids.vertices[k][0])
            right = max(right, solids.vertices[k][0])
        # On the level: to the nearer edge, and by chance from the very middle.
        offset = x - 0.5 * (left + right)
        if abs(offset) < 1e-9:
            offset = 0.5 - chance if chance != 0.5 else 1.0
        downhill = 1 if offset > 0.0 else -1
    return -downhill if not solids.is_goal[polygon] and chance < g else downhill


def walk(x, y, g, m, chances, solids, width):
    """Follow one point from its start to where it stays."""
    path = [(x, y)]
    way = [0] * len(solids.is_goal)
    on, skip = -1, -1
    while True:
        if on < 0:
            t, on = first_hit(x, y, x, -1.0, skip, solids)
            if on < 0 or t >= y / (y + 1.0):
                add_corner(path, x, 0.0)
                break
            y, skip = y - t * (y + 1.0), -1
            add_corner(path, x, y)
        if way[on] == 0:
            way[on] = direction_on(on, x, g, chances[on], solids)
        heading = way[on]
        end_x, end_y, at_edge = surface_end(on, x, y, heading, solids)
        if at_edge:
            t, hit = first_hit(x, y, x + heading * PROBE, y, on, solids)
            if hit < 0:
                carried = 0.0 if solids.is_goal[on] else heading * m
                x, on, skip = leave_edge(x, y, carried, on, width, solids)
                add_corner(path, x, y)
                continue
        else:
            t, hit = first_hit(x, y, end_x, end_y, on, solids)
            x, y = x + t * (end_x - x), y + t * (end_y - y)
            add_corner(path, x, y)
            if hit < 0 and (x <= 1e-9 or x >= width - 1e-9):
                break  # A surface that ends at the side wall.
        if hit >= 0:
            if y < top_of(hit, x + heading * 1e-8, solids)[0] - ON_TOP:
                break  # In the notch below another solid's side: no way on.
            if way[hit] == 0:
                way[hit] = direction_on(hit, x + heading * 1e-8, g, chances[hit], solids)
            if way[hit] == -heading:
                break  # Two surfaces that lead into each other.
            on = hit
    return path


def add_corner(path, x, y):
    """Append a corner unless the point hasn't moved."""
    if abs(path[-1][0] - x) + abs(path[-1][1] - y) >= 1e-9:
        path.append((x, y))


def surface_end(polygon, x, y, heading, solids):
    """End of the straight piece of surface ahead: x, y, and whether there is none (an edge)."""
    _, edge = top_of(polygon, x + heading * 1e-8, solids)
    if edge < 0:
        return x, y, True
    right = solids.vertices[edge][0]
    left = right - solids.lengths[edge] * solids.normals[edge][1]
    end_x = right if heading > 0 else left
    fall = solids.normals[edge][0] / solids.normals[edge][1]
    return end_x, solids.vertices[edge][1] - (end_x - right) * fall, False


def leave_edge(x, y, carried, polygon, width, solids):
    """Momentum past an edge: new x, the polygon landed on (or -1), and the one to fall along."""
    goal_x = min(max(x + carried, 0.0), width)
    if abs(goal_x - x) <= INSIDE:
        return x, -1, polygon
    t, hit = first_hit(x, y, goal_x, y, polygon, solids)
    x += t * (goal_x - x)
    if hit < 0:
        return x, -1, -1
    heading = 1.0 if carried > 0.0 else -1.0
    if y >= top_of(hit, x + heading * 1e-8, solids)[0] - ON_TOP:
        return x, hit, -1
    return x - heading * 1e-7, -1, hit

"""The liquid's surface as a mesh: closed, outward, and of the liquid's volume."""

from collections import Counter

import numpy as np
import pytest

from pourcast.errors import InputError
from pourcast.stimuli.recording import (
    FULL,
    Moment,
    RecordedPour,
    load_pour,
    save_pour,
)
from pourcast.stimuli.surface import EMPTY, cells_mesh, drops_mesh, liquid_mesh

CELL = 0.01


def pour_of(fill, points=(), room=None):
    moment = Moment(
        np.round(FULL * fill).astype(np.uint8), np.array(points, np.float32).reshape(-1, 4)
    )
    room = np.ones(fill.shape, np.float32) if room is None else room
    return RecordedPour((moment,), CELL, (0.0, 0.0, 0.0), room, 0.5, 0.0)


def ball(radius):
    places = np.indices((28, 28, 28)) + 0.5 - 14
    return np.clip(radius + 0.5 - np.linalg.norm(places, axis=0), 0.0, 1.0)


def is_closed(mesh):
    """Whether each edge is walked once in each direction."""
    corners = mesh.triangles
    edges = Counter(
        (int(a), int(b))
        for k in range(3)
        for a, b in zip(corners[:, k], corners[:, k - 2], strict=True)
    )
    return all(edges[b, a] == n for (a, b), n in edges.items())


@pytest.mark.parametrize(("radius", "error"), [(2.5, 0.18), (5.0, 0.045), (10.0, 0.012)])
def test_a_blobs_volume_is_kept_as_far_as_the_docstring_says(radius, error):
    one = pour_of(ball(radius))
    mesh = liquid_mesh(one, 0)
    assert mesh.volume == pytest.approx(one.volume, rel=error)
    assert is_closed(mesh)
    assert mesh.vertices.mean(axis=0) == pytest.approx([0.14] * 3, abs=1e-3)


def test_drops_are_spheres_of_their_volume():
    points = [(0.1, 0.2, 0.05, 1e-6), (0.3, 0.2, 0.05, 8e-6)]
    mesh = drops_mesh(np.array(points, np.float32))
    assert is_closed(mesh)
    assert mesh.volume == pytest.approx(9e-6, rel=1e-4)
    first = mesh.vertices[: len(mesh.vertices) // 2] - np.array(points[0][:3])
    assert np.linalg.norm(first, axis=1) == pytest.approx((0.75e-6 / np.pi) ** (1 / 3), rel=0.04)


def test_liquid_leaves_no_gap_to_what_it_lies_on():
    fill, room = np.zeros((12, 12, 12)), np.ones((12, 12, 12), np.float32)
    room[:, :4] = 0.0
    fill[:, 4:7] = 1.0
    mesh = cells_mesh(pour_of(fill, room=room).moments[0], pour_of(fill, room=room))
    assert mesh.vertices[:, 1].min() < 4 * CELL
    assert mesh.vertices[:, 1].max() == pytest.approx(7 * CELL, abs=0.4 * CELL)


def test_no_liquid_has_no_surface():
    assert (
        cells_mesh(pour_of(np.zeros((5, 5, 5))).moments[0], pour_of(np.zeros((5, 5, 5)))) is EMPTY
    )
    assert EMPTY.volume == 0.0


def test_particles_have_a_closed_surface_around_them():
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(0.1, 0.2, (60, 3)), np.full(60, 1e-6)])
    nothing = np.zeros((0, 0, 0))
    one = RecordedPour(
        (Moment(nothing.astype(np.uint8), points.astype(np.float32)),),
        0.02, (0.0, 0.0, 0.0), nothing.astype(np.float32), 0.5, 0.0,
    )  # fmt: skip
    mesh = liquid_mesh(one, 0)
    assert is_closed(mesh)
    assert mesh.volume > 0.0
    assert (mesh.vertices.min(axis=0) < points[:, :3].min(axis=0)).all()
    assert (mesh.vertices.max(axis=0) > points[:, :3].max(axis=0)).all()


def test_a_pour_is_kept_and_read_as_it_was(tmp_path):
    one = pour_of(ball(3.0), [(0.1, 0.2, 0.05, 1e-6)])
    path = tmp_path / "pour.npz"
    save_pour(path, one)
    other = load_pour(path)
    assert (other.moments[0].fill == one.moments[0].fill).all()
    assert (other.moments[0].points == one.moments[0].points).all()
    assert (other.cell, other.origin, other.outcome) == (one.cell, one.origin, one.outcome)
    assert (other.room == one.room).all()
    assert other.volume == one.volume


def test_without_the_extra_it_is_said_which_to_install(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pysplashsurf", None)
    with pytest.raises(InputError, match=r"pip install '.\[stimuli\]'"):
        liquid_mesh(pour_of(ball(3.0)), 0)

"""One particle: free fall, damped fall, contact, adhesion. Closed forms only."""

import numpy as np
import pytest

from pourcast.engine.polygons import pack_solids
from tests.make import job, run_one

STEP = 2e-4
START = np.array([[0.5, 1.3, 0.074]])
# A floor tilted by 30 degrees through (0.5, 0.5), deep enough to be a half-space.
TILT = np.radians(30.0)
DOWNHILL = np.array([np.cos(TILT), -np.sin(TILT)])
NORMAL = np.array([np.sin(TILT), np.cos(TILT)])
RAMP = pack_solids(
    [
        [
            (
                np.array(
                    [[0.02, 0.02], [0.95, 0.02], [0.95, 0.2], [0.02, 0.2 + 0.93 * np.tan(TILT)]]
                ),
                False,
            )
        ]
    ]
)


def above_ramp(height: float, x: float = 0.3) -> np.ndarray:
    """A point at a distance from the ramp's surface."""
    surface = np.array([x, 0.2 + (0.95 - x) * np.tan(TILT)])
    return np.array([[*(surface + height * NORMAL), 0.074]])


@pytest.mark.parametrize("kind", ["liquid", "marbles"])
def test_free_fall(kind):
    # y = y0 - g t^2 / 2; symplectic Euler is off by g t dt / 2.
    duration = 0.3
    end = run_one(job(START), STEP, duration, kind=kind)
    exact = 1.3 - 0.5 * 9.81 * duration**2
    assert end.position[0, 1] == pytest.approx(exact - 0.5 * 9.81 * duration * STEP, abs=2e-5)
    assert end.velocity[0, 1] == pytest.approx(-9.81 * duration, rel=1e-4)


@pytest.mark.parametrize("zeta", [1.0, 5.0, 20.0])
def test_damped_fall_follows_the_exponential_to_terminal_speed(zeta):
    # v = g / zeta (1 - exp(-zeta t)); y0 - y = g / zeta (t - (1 - exp(-zeta t)) / zeta).
    duration = 0.4
    end = run_one(job(START, damping=zeta), STEP, duration)
    gone = 1.0 - np.exp(-zeta * duration)
    assert end.velocity[0, 1] == pytest.approx(-9.81 / zeta * gone, rel=zeta * STEP)
    fallen = 9.81 / zeta * (duration - gone / zeta)
    assert 1.3 - end.position[0, 1] == pytest.approx(fallen, rel=2e-3)
    if zeta == 20.0:
        assert end.velocity[0, 1] == pytest.approx(-9.81 / zeta, rel=1e-3)


@pytest.mark.parametrize("kind", ["liquid", "marbles"])
def test_contact_takes_the_normal_speed_and_keeps_the_tangential(kind):
    radius = 0.0185
    speed = 1.0 * DOWNHILL - 2.0 * NORMAL
    one = job(
        above_ramp(radius + 0.001), velocity=np.array([[*speed, 0.3]], np.float32), gravity=0.0
    )
    end = run_one(one, STEP, 0.01, RAMP, kind=kind)
    after = end.velocity[0, :2].astype(float)
    assert after @ NORMAL == pytest.approx(0.0, abs=1e-5)
    assert after @ DOWNHILL == pytest.approx(1.0, abs=1e-5)
    assert end.velocity[0, 2] == pytest.approx(0.3, abs=1e-5)
    assert end.touched.all()


def test_frictionless_slide_down_a_ramp():
    # Along the ramp s = g sin(tilt) t^2 / 2 without friction.
    start = above_ramp(0.0185)
    duration = 0.2
    end = run_one(job(start), STEP, duration, RAMP)
    travelled = (end.position[0, :2] - start[0, :2]) @ DOWNHILL
    assert travelled == pytest.approx(0.5 * 9.81 * np.sin(TILT) * duration**2, rel=0.01)


def test_adhesion_decays_at_its_rate():
    # Tangential speed in contact: exp(-rate t). The normal one likewise, while it lasts.
    rate, duration = 60.0, 0.02
    one = job(
        above_ramp(0.0185),
        velocity=np.array([[*(0.1 * DOWNHILL), 0.1]], np.float32),
        gravity=0.0,
        adhesion_tangential=rate,
        adhesion_normal=rate,
    )
    end = run_one(one, STEP, duration, RAMP)
    left = np.exp(-rate * duration)
    assert end.velocity[0, :2] @ DOWNHILL == pytest.approx(0.1 * left, rel=0.01)
    assert end.velocity[0, 2] == pytest.approx(0.1 * left, rel=0.01)


def test_normal_adhesion_holds_back_what_leaves():
    rate, duration = 60.0, 0.02
    leaving = job(
        above_ramp(0.0185),
        velocity=np.array([[*(0.02 * NORMAL), 0.0]], np.float32),
        gravity=0.0,
        adhesion_normal=rate,
    )
    end = run_one(leaving, STEP, duration, RAMP)
    assert end.velocity[0, :2] @ NORMAL == pytest.approx(0.02 * np.exp(-rate * duration), rel=0.01)


def test_sticky_slide_reaches_g_sin_over_rate():
    # Adhesion against gravity: terminal speed g sin(tilt) / rate along the ramp.
    one = job(above_ramp(0.0185), adhesion_tangential=60.0, adhesion_normal=60.0)
    end = run_one(one, STEP, 0.3, RAMP)
    speed = end.velocity[0, :2] @ DOWNHILL
    assert speed == pytest.approx(9.81 * np.sin(TILT) / 60.0, rel=0.02)


def test_free_fall_error_is_first_order_in_the_step():
    # Symplectic Euler: halving the step halves the error.
    exact = 1.3 - 0.5 * 9.81 * 0.4**2
    steps = np.array([4e-3, 2e-3, 1e-3])
    errors = [abs(run_one(job(START), s, 0.4).position[0, 1] - exact) for s in steps]
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order == pytest.approx(1.0, abs=0.05)

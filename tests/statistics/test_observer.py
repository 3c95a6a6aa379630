import numpy as np
import pytest

from pourcast.errors import InputError
from pourcast.statistics.observer import Population, spread_over_grid
from pourcast.statistics.recovery import confusion, recover_parameters

QUIET = Population(
    bias=0, bias_sd=0, slope=1, slope_sd=0, precision=9, precision_log_sd=0, lapse=0, granularity=0
)


def test_answers_have_the_mean_and_variance_of_the_beta_distribution():
    rng = np.random.default_rng(0)
    judgments = np.array([0.2, 0.5, 0.9])
    answers = QUIET.respond(judgments, QUIET.draw(20_000, rng), rng)
    assert answers.mean(axis=0) == pytest.approx(judgments, abs=0.01)
    assert answers.var(axis=0) == pytest.approx(judgments * (1 - judgments) / 10, rel=0.05)


def test_bias_slope_lapse_and_granularity():
    rng = np.random.default_rng(0)
    judgments = np.array([0.3, 0.9])
    leaning = Population(
        bias=0.1, bias_sd=0, slope=0.5, slope_sd=0, precision=1000, lapse=0, granularity=0.05
    )
    answers = leaning.respond(judgments, leaning.draw(2000, rng), rng)
    assert answers.mean(axis=0) == pytest.approx([0.5, 0.8], abs=0.01)
    assert np.abs(answers / 0.05 - np.round(answers / 0.05)).max() < 1e-9
    lapsing = Population(precision=1e4, lapse=1.0)
    assert lapsing.respond(judgments, lapsing.draw(2000, rng), rng).mean(axis=0) == pytest.approx(
        [0.5, 0.5], abs=0.03
    )


@pytest.mark.parametrize(
    ("field", "value"),
    [("lapse", 1.5), ("precision", 0), ("slope", float("nan")), ("granularity", -1)],
)
def test_bad_populations(field, value):
    with pytest.raises(InputError, match=field):
        Population(**{field: value})


def test_places_stay_on_the_grid():
    places = spread_over_grid(1, 3.0, 5, 1000, np.random.default_rng(0))
    assert set(places) == set(range(5))


def along_zeta(count=17, scenes=60, seed=0):
    """Judgments that change smoothly along a parameter, as along zeta."""
    rng = np.random.default_rng(seed)
    start, end, bend = rng.random((3, scenes))
    share = np.linspace(0, 1, count)[:, None]
    return np.clip(start + (end - start) * share + (bend - 0.5) * np.sin(np.pi * share), 0, 1)


def test_planted_parameters_are_recovered():
    # Scenes are drawn that tell the values apart; observers answer as the default ones do.
    recovered = recover_parameters(
        along_zeta(),
        [5],
        observers=30,
        studies=100,
        population=Population(),
        rng=np.random.default_rng(1),
    )
    assert (np.abs(recovered[0] - 5) <= 1).sum() >= 90
    assert confusion(recovered, 17).sum() == 100

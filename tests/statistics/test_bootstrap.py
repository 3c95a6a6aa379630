import numpy as np
import pytest
from scipy import stats

from pourcast.statistics.bootstrap import interval, resample, two_sided_p
from pourcast.statistics.correlation import agreement, pearson
from tests.yardstick import ratio


def study(seed=0, people=20, scenes=30, noise=0.2):
    rng = np.random.default_rng(seed)
    truth = rng.random(scenes)
    return truth, np.clip(truth + noise * rng.standard_normal((people, scenes)), 0, 1)


def test_over_scenes_as_scipy_bootstraps():
    truth, responses = study()
    means = responses.mean(axis=0)
    drawn = resample(responses, "scenes", np.random.default_rng(1), 20_000)
    low, high = interval(pearson(drawn.means, truth[None], drawn.weights)[:, 0], 0.95)
    theirs = stats.bootstrap(
        (means, truth), lambda x, y: stats.pearsonr(x, y).statistic, paired=True, vectorized=False,
        n_resamples=4000, method="percentile", rng=np.random.default_rng(2),
    ).confidence_interval  # fmt: skip
    assert low == pytest.approx(theirs.low, abs=0.006)
    assert high == pytest.approx(theirs.high, abs=0.004)


def test_over_participants_as_a_loop_says():
    truth, responses = study(people=6)
    responses[2, 5] = responses[4, 5] = np.nan
    drawn = resample(responses, "participants", np.random.default_rng(1), 4000)
    low, high = interval(pearson(drawn.means, truth[None], drawn.weights)[:, 0], 0.95)
    rng, loop = np.random.default_rng(5), []
    for _ in range(4000):
        drawn = responses[rng.integers(0, 6, 6)]
        there = np.isfinite(drawn).any(axis=0)
        means = np.full(len(truth), np.nan)
        means[there] = np.nanmean(drawn[:, there], axis=0)
        loop.append(np.corrcoef(means[there], truth[there])[0, 1])
    assert (low, high) == pytest.approx(np.percentile(loop, [2.5, 97.5]), abs=0.01)


def test_a_resample_without_answers_to_a_scene_leaves_it_out():
    truth, responses = study(people=5)
    responses[:4, 0] = np.nan
    drawn = resample(responses, "participants", np.random.default_rng(1), 500)
    gone = drawn.weights[:, 0] == 0
    assert 0.1 < gone.mean() < 0.6  # (4/5)^5 = 0.33
    assert np.isfinite(pearson(drawn.means, truth[None], drawn.weights)).all()


def test_fisher_intervals_in_the_gaussian_case():
    # Over scenes, of two Gaussian variables, the interval is Fisher's: tanh(atanh r +- 1.96 /
    # sqrt(n - 3)), to the bootstrap's bias of order 1/n.
    rng = np.random.default_rng(3)
    n = 400
    x = rng.standard_normal(n)
    y = 0.7 * x + np.sqrt(1 - 0.49) * rng.standard_normal(n)
    drawn = resample(y[None], "scenes", rng, 10_000)
    low, high = interval(pearson(drawn.means, x[None], drawn.weights)[:, 0], 0.95)
    r = np.corrcoef(x, y)[0, 1]
    fisher = np.tanh(np.arctanh(r) + np.array([-1.96, 1.96]) / np.sqrt(n - 3))
    assert (low, high) == pytest.approx(fisher, abs=0.012)


def test_intervals_over_scenes_cover_the_true_correlation():
    covered, rho, n = 0, 0.6, 80
    for seed in range(200):
        rng = np.random.default_rng(seed)
        x = rng.standard_normal(n)
        y = rho * x + np.sqrt(1 - rho**2) * rng.standard_normal(n)
        drawn = resample(y[None], "scenes", rng, 600)
        low, high = interval(pearson(drawn.means, x[None], drawn.weights)[:, 0], 0.95)
        covered += low <= rho <= high
    assert covered >= 182  # 190 expected; 182 is 2.6 standard errors below


def test_crossed_intervals_are_the_widest():
    truth, responses = study(people=8, noise=0.4)
    widths = {}
    for resampled in ("participants", "scenes", "both"):
        drawn = resample(responses, resampled, np.random.default_rng(1), 4000)
        low, high = interval(pearson(drawn.means, truth[None], drawn.weights)[:, 0], 0.95)
        widths[resampled] = high - low
    assert widths["both"] > widths["scenes"]
    assert widths["both"] > widths["participants"]


def test_same_seed_same_bytes():
    _, responses = study()
    one, two = (resample(responses, "both", np.random.default_rng(7), 50) for _ in range(2))
    assert one.means.tobytes() == two.means.tobytes()
    assert one.weights.tobytes() == two.weights.tobytes()


def test_paired_differences_of_equal_models_are_nothing():
    truth, responses = study()
    drawn = resample(responses, "both", np.random.default_rng(1), 200)
    r = pearson(drawn.means, np.stack([truth, 2 * truth + 1]), drawn.weights)
    assert np.abs(r[:, 0] - r[:, 1]).max() < 1e-9


def test_two_sided_p():
    differences = np.stack([np.linspace(-1, 1, 1001), np.linspace(0.1, 1, 1001)], axis=1)
    p = two_sided_p(differences)
    assert p[0] == pytest.approx(1.0, abs=0.01)
    assert p[1] == pytest.approx(2 / 1002)


def test_the_paper_s_size_takes_little_more_than_its_products_of_matrices():
    rng = np.random.default_rng(0)
    responses, models = rng.random((65, 120)), rng.random((12, 120))

    def intervals():
        for resampled in ("participants", "scenes", "both"):
            drawn = resample(responses, resampled, rng, 10_000)
            interval(agreement(drawn.means, models, drawn.weights).r, 0.95)

    def products():
        people, scenes = (
            rng.multinomial(count, np.full(count, 1 / count), 10_000).astype(float)
            for count in responses.shape
        )
        return scenes * (people @ responses) @ models.T

    # Measured: 3.7 times drawing and multiplying once.
    assert ratio(intervals, products) < 10.0

"""Experiment 2's choice: scenes on which water and honey disagree, both ways and steadily."""

from dataclasses import replace

import numpy as np
import pytest

from pourcast.errors import InputError
from pourcast.scenes.families.shapes import ShapesFamily
from pourcast.scenes.scene_file import scenes_to_json
from pourcast.study.contrast import SteadyContrast, most_contrasting
from pourcast.study.exchange import ContrastTargets, choose_steady
from pourcast.study.experiments.registry import EXPERIMENTS
from pourcast.study.selection import CoarseFilter

TARGETS = ContrastTargets()
COARSE = SteadyContrast(
    rule=CoarseFilter(n_particles=8, max_stranded=0.5, min_touched=0.5),
    candidates=40,
    truths=(
        "ife:n_particles=12,damping_zeta=0,zeta_sigma=0,liquid=water",
        "ife:n_particles=12,damping_zeta=0,zeta_sigma=0,liquid=honey",
    ),
    models=(
        "ife:n_particles=8,zeta_sigma=1,liquid=water",
        "ife:n_particles=8,zeta_sigma=1,liquid=honey",
    ),
    confirmed=4.0,
    lenient=True,
)
"""As the experiment chooses, with few particles."""


def judged_pool(count, correlation, seed=0):
    """Judgments as unselected scenes have them, by truths and by models; and unsteadiness."""
    rng = np.random.default_rng(seed)
    within = np.kron([[1.0, 0.8], [0.8, 1.0]], [[1.0, correlation], [correlation, 1.0]])
    drawn = rng.multivariate_normal(np.full(4, 0.4), 0.12 * within, count).T
    return np.clip(drawn, 0.0, 1.0), rng.exponential(0.03, count)


def figures_of(judgments):
    r = np.corrcoef(judgments)
    return r[0, 1], r[2, 3], r[0, 2], judgments.std(axis=1).min()


def test_a_choice_has_what_is_asked_and_is_steadier_than_the_pool():
    judgments, unsteady = judged_pool(1500, 0.5)
    chosen = choose_steady(judgments, unsteady, 60, TARGETS)
    assert len(set(chosen)) == 60
    truths, models, followed, spread = figures_of(judgments[:, chosen])
    assert truths <= TARGETS.truths + 1e-6
    assert models <= TARGETS.models + 1e-6
    assert TARGETS.followed - 1e-6 <= followed <= TARGETS.told_apart + 1e-6
    assert spread >= TARGETS.spread - 1e-6
    assert judgments[:, chosen].std(axis=1).max() <= TARGETS.most_spread + 1e-6
    water, honey = judgments[::2, chosen], judgments[1::2, chosen]
    assert np.sum(np.all(water > honey, axis=0)) == 30
    assert np.sum(np.all(water < honey, axis=0)) == 30
    # A random thirty-thirty of the same pool has the mean of all.
    assert unsteady[chosen].mean() < 0.5 * unsteady.mean()


def test_no_exchange_of_one_scene_is_any_better():
    judgments, unsteady = judged_pool(200, 0.5)
    chosen = choose_steady(judgments, unsteady, 12, TARGETS)
    sign = np.sign(judgments[0] - judgments[1])
    others = set(np.flatnonzero(sign == np.sign(judgments[2] - judgments[3]))) - set(chosen)
    exchanges = 0
    for leaves in chosen:
        for comes in (k for k in others if sign[k] == sign[leaves]):
            if unsteady[comes] >= unsteady[leaves]:
                continue
            exchanged = [comes, *(k for k in chosen if k != leaves)]
            truths, models, followed, spread = figures_of(judgments[:, exchanged])
            exchanges += 1
            assert (
                truths > TARGETS.truths
                or models > TARGETS.models
                or not TARGETS.followed <= followed <= TARGETS.told_apart
                or spread < TARGETS.spread
                or judgments[:, exchanged].std(axis=1).max() > TARGETS.most_spread
            )
    assert exchanges > 20


def test_the_same_set_whatever_the_order_of_candidates():
    judgments, unsteady = judged_pool(400, 0.4)
    chosen = choose_steady(judgments, unsteady, 20, TARGETS)
    order = np.random.default_rng(1).permutation(400)
    again = choose_steady(judgments[:, order], unsteady[order], 20, TARGETS)
    assert sorted(order[again]) == list(chosen)


def test_what_could_not_be_had_is_said():
    judgments, unsteady = judged_pool(60, 0.9)
    said = (
        r"^found no 20 scenes as asked; the nearest miss the correlation of the truths by \d\.\d+, "
        r"the correlation of the models by \d\.\d+"
    )
    with pytest.raises(InputError, match=said):
        choose_steady(judgments, unsteady, 20, TARGETS)
    assert len(choose_steady(judgments, unsteady, 20, TARGETS, lenient=True)) == 20
    narrow = 0.5 + 0.1 * (judgments - 0.5)
    with pytest.raises(
        InputError, match=r"the nearest miss the smallest standard deviation by 0.2\d$"
    ):
        choose_steady(narrow, unsteady, 10, ContrastTargets(truths=1, models=1, followed=-1))
    all_water = np.stack([judgments[0] + 2, judgments[1], judgments[2] + 2, judgments[3]])
    with pytest.raises(InputError, match=r"expected 10 scenes with more honey .*, found 0"):
        choose_steady(all_water, unsteady, 20, TARGETS)
    assert len(choose_steady(all_water, unsteady, 60, TARGETS, lenient=True)) == 60
    with pytest.raises(InputError, match=r"expected 31 scenes with more water .*, found 30"):
        choose_steady(all_water, unsteady, 61, TARGETS, lenient=True)


def test_targets_are_in_their_ranges():
    with pytest.raises(InputError, match=r"contrast targets: spread: expected 0 to 0.5, found 2"):
        ContrastTargets(spread=2)


def test_the_screen_keeps_what_parts_farthest_by_truths_and_models():
    screened = np.array(
        # water's truth, honey's, water's model, honey's
        [[0.9, 0.1, 0.9, 0.1], [0.9, 0.1, 0.5, 0.5], [0.5, 0.4, 0.6, 0.4],
         [0.1, 0.9, 0.2, 0.9], [0.1, 0.9, 0.9, 0.1], [0.4, 0.5, 0.4, 0.6]]
    ).T  # fmt: skip
    assert most_contrasting(screened, 1).tolist() == [0, 3]
    assert most_contrasting(screened, 2).tolist() == [0, 2, 3, 5]
    assert most_contrasting(screened, 9).tolist() == [0, 1, 2, 3, 4, 5]


def test_scenes_are_chosen_in_stages_that_are_told():
    seen = set()
    chosen = COARSE.choose(ShapesFamily(), 6, 1, lambda what, *_: seen.add(what))
    again = COARSE.choose(ShapesFamily(), 6, 1)
    assert scenes_to_json(chosen.scenes) == scenes_to_json(again.scenes)
    assert [scene.id for scene in chosen.scenes] == [f"exp2-{k:03d}" for k in range(1, 7)]
    drawn, kept, judged, run_off, moved, wanted = chosen.left
    assert drawn >= kept >= 40 >= judged >= run_off == moved > wanted == 6
    assert len(COARSE.stages) == len(chosen.left)
    assert {"screening", f"judging the {judged} most promising scenes"} <= seen
    truths = "correlation of " + " and ".join(COARSE.truths)
    assert chosen.figures[truths] < chosen.figures[f"{truths}, all candidates"]
    assert chosen.figures[f"share of scenes with more {' than '.join(COARSE.truths)}"] == 0.5


def test_the_nearest_set_says_what_it_misses():
    strict = replace(COARSE, targets=ContrastTargets(truths=-1.0))
    figures = strict.choose(ShapesFamily(), 6, 1).figures
    truths = "correlation of " + " and ".join(COARSE.truths)
    by = figures["asked, and missed: correlation of the truths, by"]
    assert by == pytest.approx(figures[truths] + 1.0)
    few = strict.choose(ShapesFamily(), 3, 1).figures
    assert not any("missed" in words for words in few)


def test_liquids_are_judged_from_moved_starts_too():
    figures = COARSE.choose(ShapesFamily(), 6, 1).figures
    still = replace(COARSE, moved=0.0).choose(ShapesFamily(), 6, 1).figures
    for name in COARSE.judges:
        assert still[f"mean variance of {name} over the starts"] == 0.0
        assert 0.0 < figures[f"mean variance of {name} over the starts"] < 0.1
    both = "correlation of " + " and ".join(COARSE.truths)
    assert still[f"{both}, start 0 cm to the left"] == still[both]


def test_a_pool_without_what_is_asked_is_one_line():
    strict = replace(COARSE, lenient=False, targets=ContrastTargets(truths=-1.0))
    with pytest.raises(InputError) as refused:
        strict.choose(ShapesFamily(), 6, 1)
    assert "\n" not in str(refused.value)
    assert "of 40 candidates; a larger pool may have them" in str(refused.value)
    with pytest.raises(InputError, match="candidates: expected at least 6"):
        replace(COARSE, candidates=5).choose(ShapesFamily(), 6, 1)
    with pytest.raises(InputError, match="model 'gravity': expected one that averages pours"):
        replace(COARSE, models=("gravity", "water-ife")).choose(ShapesFamily(), 6, 1)


def test_experiment_2_says_how_its_scenes_are_chosen():
    choice = EXPERIMENTS.get("exp2").choice
    assert isinstance(choice, SteadyContrast)
    names, rules = zip(*choice.stages, strict=True)
    assert names == ("drawn", "filtered", "judged", "run off", "moved", "chosen")
    assert "correlation of the truths at most -0.65" in rules[-1]


@pytest.mark.study
def test_experiment_2_has_contrast_in_truths_and_models():
    experiment = EXPERIMENTS.get("exp2")
    selection = experiment.choice.choose(experiment.family, experiment.scene_count, 5)
    figures = selection.figures
    assert figures["correlation of truth-water and truth-honey"] <= -0.6
    assert figures["correlation of water-ife and honey-ife-1"] <= -0.6
    assert figures["correlation of water-ife and truth-water"] >= 0.4
    names = ("truth-water", "truth-honey", "water-ife", "honey-ife-1")
    assert all(figures[f"standard deviation of {name}"] >= 0.25 for name in names)
    for both in ("truth-water than truth-honey", "water-ife than honey-ife-1"):
        assert figures[f"share of scenes with more {both}"] == 0.5
    for side in ("left", "right"):
        moved = f"start 1 cm to the {side}"
        assert figures[f"correlation of truth-water and truth-honey, {moved}"] <= -0.5
        assert figures[f"correlation of water-ife and honey-ife-1, {moved}"] <= -0.45
    assert not any("missed" in words for words in figures)
    assert len({scene.digest for scene in selection.scenes}) == 60

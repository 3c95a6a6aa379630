import numpy as np
import pytest

from pourcast.errors import InputError
from pourcast.models.registry import make_model
from pourcast.observers.observers import Observers, simulate_observers
from pourcast.statistics.observer import Population
from pourcast.study.trials import arrange
from tests.test_responses import scenes

HEADS = {"water": "water-ife", "honey": "honey-ife-2"}


def judge(heads):
    """What a model in a head says, here: its damping, as a share of 20."""
    return {
        (liquid, spec): np.full(3, make_model(spec).damping_zeta / 20) for liquid, spec in heads
    }


ONE_LIQUID_EACH = (("water",), ("honey",))


def table_of(count, *, groups=ONE_LIQUID_EACH, seed=0, **more):
    return simulate_observers(scenes(), Observers(count, HEADS, groups, seed=seed, **more), judge)


def test_every_row_says_that_it_is_simulated():
    table = table_of(5)
    assert table["simulated"].all()
    assert table["participant"].str.startswith("sim-").all()
    assert table["response"].between(0, 1).all()


def test_between_participants_each_sees_one_liquid():
    table = table_of(5)
    assert (table.groupby("participant")["liquid"].nunique() == 1).all()
    assert table.groupby("liquid")["participant"].nunique().to_dict() == {"water": 3, "honey": 2}
    assert (table.groupby("participant")["trial"].apply(list).map(sorted) == [[1, 2, 3]] * 5).all()


def test_within_participants_each_sees_both():
    table = table_of(4, groups=())
    assert len(table) == 24
    assert (table.groupby("participant")["liquid"].nunique() == 2).all()
    orders = table.groupby("participant")[["scene", "liquid"]].apply(
        lambda t: tuple(map(tuple, t.to_numpy()))
    )
    assert orders.nunique() == 1


def test_an_observer_answers_the_same_however_many_others_do():
    few, many = table_of(3), table_of(30)
    assert few.equals(many[many["participant"].isin(few["participant"])].reset_index(drop=True))
    assert not few["response"].equals(table_of(3, seed=1)["response"])


def test_observers_differ_in_their_parameters():
    table = table_of(400)
    water = table[table["liquid"] == "water"].drop_duplicates("participant")["model"]
    zetas = np.array([make_model(spec).damping_zeta for spec in water])
    assert np.unique(zetas).size > 3
    assert (zetas == np.round(zetas)).all()
    assert zetas.mean() == pytest.approx(5, abs=0.3)
    assert zetas.std() == pytest.approx(1.5, abs=0.2)
    same = table_of(10, spreads={})
    assert set(same["model"]) == set(HEADS.values())


def test_answers_follow_the_heads():
    quiet = Population(bias_sd=0, slope=1, slope_sd=0, precision=1e4, lapse=0, granularity=0)
    table = table_of(8, population=quiet)
    heads = np.array([make_model(spec).damping_zeta / 20 for spec in table["model"]])
    assert table["response"].to_numpy() == pytest.approx(heads, abs=0.03)


def test_they_can_be_read_as_responses(tmp_path):
    from pourcast.study.responses import read_responses

    path = tmp_path / "r.csv"
    table_of(6).to_csv(path, index=False)
    found = arrange(read_responses(path, scenes()), scenes(), "")
    assert [len(one.participants) for one in found] == [3, 3]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"count": 0}, "observers: expected at least 1"),
        ({"models": {"water": "wine-ife"}}, "there is no 'wine-ife'"),
        ({"groups": (("oil",),)}, "observers: oil: no model for the trials of this liquid"),
        ({"spreads": {"zeta": 1.0}}, "vary: there is no 'zeta'"),
        ({"spreads": {"m": -1.0}}, "vary: m: expected 0 or more"),
    ],
)
def test_bad_observers(change, said):
    with pytest.raises(InputError, match=said):
        Observers(**({"count": 3, "models": HEADS, "groups": ONE_LIQUID_EACH} | change))

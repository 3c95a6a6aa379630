import html
import json
import re
from dataclasses import asdict, replace
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest

import pourcast
from pourcast.comparison.compare import compare_study
from pourcast.comparison.matching import ComparisonOptions
from pourcast.errors import InputError
from pourcast.report.methods import methods, provenance
from pourcast.report.numbers import how_drawn
from pourcast.report.page import Options, with_published, write_report
from pourcast.scenes.liquids.registry import HONEY_EXP1, HONEY_EXP2, WATER
from pourcast.simulation.pour import Pour
from pourcast.simulation.settings import EngineSettings
from pourcast.study.chosen import how_chosen, read_chosen
from pourcast.study.experiments.registry import EXPERIMENTS
from pourcast.study.selection import Selection


@pytest.fixture(scope="module")
def page(comparison, tmp_path_factory):
    return write_report(comparison, tmp_path_factory.mktemp("report"), Options(films=1, studies=4))


class Addresses(HTMLParser):
    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attrs):
        self.found += [(tag, value) for name, value in attrs if name in ("src", "href")]


def test_the_page_needs_no_other_file(page):
    parser = Addresses()
    parser.feed(page.read_text())
    assert len(parser.found) > 10
    for tag, address in parser.found:
        assert address.startswith(("data:", "#")), (tag, address[:80])


def test_everything_says_simulated(page):
    text = page.read_text()
    assert re.search(r"<title>Simulated observers: ", text)
    assert "The responses in this report are <b>simulated</b>" in text
    for summary in re.findall(r"<summary>(.*?)</summary>", text):
        assert "simulated" in summary or "made from" in summary
    of_people = (
        "correlations",
        "differences_water",
        "best_honey",
        "model_recovery_water",
        "zeta_profiles",
    )
    for name in of_people:
        assert "simulated observers" in (page.parent / "figures" / f"{name}.svg").read_text()
    for table in (page.parent / "tables").glob("*.csv"):
        assert pd.read_csv(table)["simulated"].all(), table


def test_the_scatter_plot_s_data(page, comparison):
    text = re.search(
        r'<script id="explore-data" type="application/json">(.*?)</script>', page.read_text()
    ).group(1)
    content = json.loads(text)
    one = comparison.compared[0]
    assert content["liquids"][0]["people"] == pytest.approx(
        one.trials.responses.mean(axis=0), abs=1e-4
    )
    assert set(content["scenes"]) == {scene.id for scene in comparison.scenes}


def test_methods_and_provenance(page, comparison):
    text = page.read_text()
    assert "6 participants judged 10 scenes of water" in text
    assert "No participants or trials were excluded." in text
    assert "intervals over participants and scenes" in text
    assert comparison.source[1] in text
    assert "scenes.json" in text


def test_methods_say_how_pours_were_computed(page, comparison):
    engine, text = EngineSettings(), html.unescape(page.read_text())
    scale, radius = engine.damping_scale, engine.contact_radius
    assert (
        f"lowered by {scale:g} zeta times the velocity (zeta = 5/s damps at {5 * scale:g}/s)"
        in text
    )
    assert f"as spheres with a radius of {radius:g} particle spacings" in text
    assert "marbles" not in methods(comparison)
    for liquid in (WATER, HONEY_EXP1):
        numbers = "; ".join(f"{name} = {v:g}" for name, v in liquid.engine_identity.items())
        assert f"<td>{liquid.name}</td><td><code>{numbers}</code></td>" in text
    assert (
        f"water (alpha = {WATER.viscosity_alpha:g}, no cohesion, no adhesion); honey-exp1 (alpha = "
        f"{HONEY_EXP1.viscosity_alpha:g}, cohesion {HONEY_EXP1.cohesion:g} m³/s², adhesion "
        f"{HONEY_EXP1.adhesion_normal:g} 1/s normal and {HONEY_EXP1.adhesion_tangential:g} 1/s "
        "tangential)"
    ) in text
    for name, value in asdict(engine).items():
        assert f"{name} = {value if isinstance(value, str) else format(value, 'g')}" in text


def test_methods_say_what_marbles_are_and_what_models_override(comparison):
    scene = comparison.scenes[0]
    pours = (
        Pour(scene, WATER, 15, 2.0, kind="marbles"),
        Pour(scene, replace(HONEY_EXP1, viscosity_alpha=7.0), 15, 4.0),
    )
    said = methods(replace(comparison, pours=pours))
    assert f"marbles have a radius of {EngineSettings().marble_radius:g} particle spacings" in said
    assert "The liquids are honey-exp1 (alpha = 7, " in said
    assert "In the particle engine" not in methods(replace(comparison, pours=()))


def test_methods_name_a_sweep_s_own_engine_settings(comparison):
    judged = replace(comparison.judged, engines={"soft": {"damping_scale": 0.5}})
    other = replace(comparison, judged=judged)
    assert "Judgments of the sweep 'soft' were computed with damping_scale = 0.5." in methods(other)
    assert ("engine settings of the sweep soft, where others", "damping_scale = 0.5") in provenance(
        other
    )


def test_how_scenes_were_chosen_is_in_words():
    experiment = EXPERIMENTS.get("exp2")
    left = tuple(range(9, 9 - len(experiment.choice.stages), -1))
    selection = Selection([], 9, 9, left)
    rows = dict(how_drawn(how_chosen(experiment.family, experiment.choice, selection)))
    assert rows["drawn by"] == f"pourcast {pourcast.__version__}"
    assert "shape count 3; " in rows["statistics of the draws (exp2), in SI units"]
    assert "200 particles of water, zeta = 0/s" in rows["poured into each"]
    assert f"cohesion {HONEY_EXP2.cohesion:g} m³/s²" in rows["liquids"]
    assert f"damping_scale = {EngineSettings().damping_scale:g}; " in rows["engine settings"]
    assert (
        "50 particles of honey-exp2, zeta = 1, 2, 3, 4, 5, 6, 7, 8, 9/s"
        in (rows["poured into each"])
    )


def test_how_scenes_of_an_older_release_were_chosen(tmp_path):
    path = tmp_path / "chosen.json"
    path.write_text('{"pourcast": "0.1.0", "family": {"cell_count": 7}, "stages": []}')
    assert how_drawn(read_chosen(tmp_path)) == [
        ("drawn by", "pourcast 0.1.0"),
        ("statistics of the draws, in SI units", "cell count 7"),
    ]


def test_people_s_reports_say_nothing_of_simulation(study, tmp_path):
    table = pd.read_csv(study / "responses" / "simulated.csv").assign(simulated=False)
    path = tmp_path / "people.csv"
    table.to_csv(path, index=False)
    request = ComparisonOptions(
        responses=path, models=("gravity", "water-simple"), exclude=("max-rt=8",)
    )
    found = compare_study(study, request)
    assert not found.simulated
    text = write_report(found, tmp_path / "report", Options(films=0, studies=0)).read_text()
    assert "imulated observers" not in text
    assert "<code>max-rt=8</code>" in text
    assert "Excluded were, by rule: max-rt=8 (0 participants," in text
    assert "simulated" not in pd.read_csv(tmp_path / "report" / "tables" / "agreement.csv")


def test_the_same_report_has_the_same_bytes(comparison, page, tmp_path):
    again = write_report(comparison, tmp_path, Options(films=1, studies=4))
    assert again.read_text() == page.read_text()


def test_published_values_stand_beside(comparison):
    table = with_published(comparison.tables["agreement"], EXPERIMENTS.get("exp1"))
    place = list(table.columns).index("published_r")
    assert table.columns[place - 3 : place].tolist() == ["r", "r_low", "r_high"]
    row = table[(table["model"] == "gravity") & (table["liquid"] == "water")].iloc[0]
    assert (row["published_r"], row["published_r_low"]) == (0.58, 0.55)
    assert np.isnan(table[table["model"].str.startswith("ife")]["published_r"]).all()


def test_what_is_wrong_is_said_in_one_line(study, tmp_path):
    with pytest.raises(InputError, match="expected a study folder"):
        compare_study(tmp_path / "nowhere", ComparisonOptions())
    with pytest.raises(InputError, match="there is no 'watr-ife'"):
        compare_study(study, ComparisonOptions(models=("watr-ife",)))
    two = study.parent / "two"
    (two / "responses").mkdir(parents=True)
    (two / "scenes.json").write_bytes((study / "scenes.json").read_bytes())
    with pytest.raises(InputError, match="no table of responses"):
        compare_study(two, ComparisonOptions())
    for name in "ab":
        (two / "responses" / f"{name}.csv").write_text("x\n")
    with pytest.raises(
        InputError, match=r"more than one source of responses \(responses.a.csv, responses.b.csv\)"
    ):
        compare_study(two, ComparisonOptions())
    table = pd.read_csv(study / "responses" / "simulated.csv")
    few = tmp_path / "few.csv"
    table[table["scene"].isin(["s00", "s01"])].to_csv(few, index=False)
    with pytest.raises(InputError, match="water: 2 scenes were answered, expected at least 3"):
        compare_study(study, ComparisonOptions(responses=few))

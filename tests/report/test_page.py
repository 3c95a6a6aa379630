import json
import re
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest

from pourcast.comparison.compare import ComparisonOptions, compare_study
from pourcast.errors import InputError
from pourcast.report.page import Options, with_published, write_report
from pourcast.study.experiments.registry import EXPERIMENTS


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
    assert "500 bootstrap resamples of participants" in text
    assert comparison.source[1] in text
    assert "scenes.json" in text


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

"""Tables on a terminal: no number is broken, however many columns there are."""

import pandas as pd
import pytest

from pourcast.cli.terminal import print_columns, print_table


@pytest.fixture
def printed(capsys, monkeypatch):
    def lines_of(show, width):
        monkeypatch.setenv("COLUMNS", str(width))
        show()
        return capsys.readouterr().out.splitlines()

    return lines_of


def recovered():
    """As `recover parameters` prints it: 17 planted values, 17 recovered ones."""
    values = [str(value) for value in range(17)]
    table = pd.DataFrame(0.98, columns=values, index=pd.Index(values, name="planted"))
    print_table(table.assign(**{"within one step": 1.0}))


@pytest.mark.parametrize("width", [24, 80, 300])
def test_no_number_is_broken(printed, width):
    lines = printed(recovered, width)
    assert max(map(len, lines)) <= width
    rows = [line.split() for line in lines if line.startswith("16 ")]
    assert {label for label, *_ in rows} == {"16"}
    numbers = [number for _, *numbers in rows for number in numbers]
    assert numbers == ["0.98"] * 17 + ["1.00"]
    assert (len(rows) == 1) == (width == 300)


def test_each_part_has_its_headings(printed):
    lines = printed(recovered, 80)
    headings = [line.split() for line in lines if line.startswith("planted")]
    assert headings[0][:3] == ["planted", "0", "1"]
    assert headings[1][0] == "planted"
    assert [*headings[0][1:], *headings[1][1:]][:17] == [str(value) for value in range(17)]


def test_long_texts_share_what_room_there_is(printed):
    columns = {"model": ["a"], "N": [50], "meaning": ["a liquid in the head " * 8]}
    lines = printed(lambda: print_columns(columns), 60)
    assert lines[1].startswith("a      50  a liquid in the head")
    assert max(map(len, lines)) <= 60
    assert sum(line.startswith("model") for line in lines) == 1

"""Charts: what they imply, and what is wrong with them."""

from __future__ import annotations

import pytest

from yarnscale.drawing.chart_error import ChartError
from yarnscale.drawing.stitches import StitchChart
from yarnscale.errors import InputError


def test_stockinette_word() -> None:
    assert StitchChart.read("k").words == ["UOOUUOOU"]
    assert StitchChart.read("p").words == ["OUUOOUUO"]


def test_a_slip_holds_the_loop_and_floats_on_its_side() -> None:
    """The held loop's leg lies before the float behind it, and is drawn through two courses later."""
    chart = StitchChart.read(["kk", "kb"])
    assert chart.next_knit(0, 1) == 2
    assert chart.held(0, 1) == [2]
    assert chart.words[1] == "UOOUUOOU" + "UU"
    assert chart.words[0] == "UOOUUOOU" + "UO" + "O" + "OU" + "UO" + "O" + "OU"
    front = StitchChart.read(["kk", "kf"])
    assert front.words[1].endswith("OO")


def test_a_miss_floats_on_the_back_of_its_loop() -> None:
    assert StitchChart.read(["kp", "k-", "-p"]).float_sign(1, 1) == 1
    assert StitchChart.read(["kp", "k-", "-p"]).float_sign(2, 0) == -1


def test_tucks_wait_with_the_held_loop() -> None:
    """The next knit enters behind both loops' legs and leaves over both heads."""
    chart = StitchChart.read(["k", "t"])
    assert chart.held(0, 0) == [2, 1]
    knit, tuck = chart.words
    assert knit == "UUOO" + "OU" + "UO" + "OOUU"
    assert tuck == "OU" + "UO"


def test_needles_out_of_work_hold_nothing() -> None:
    """The yarn passes straight from wale to wale, in front of and behind nothing."""
    chart = StitchChart.read(["k-p", "kbp"])
    assert chart.empty == (False, True, False)
    assert chart.words == [StitchChart.read("kp").words[0]] * 2
    rib = StitchChart.read(["k-|-p"])
    assert rib.empty == (False, True, True, False) and rib.words == StitchChart.read("kp").words


def test_two_beds_alternate() -> None:
    chart = StitchChart.read(["k-|-p", "-k|p-"])
    assert chart.beds == 2
    assert chart.rows == ("k--p", "-pk-")
    assert chart.place(1, 1) == "row 2 back needle 1"
    # Floats run between the beds: behind the front loops, before the back ones.
    assert [chart.float_sign(0, column) for column in (1, 2)] == [1, -1]


@pytest.mark.parametrize(
    ("chart", "message", "row", "column"),
    [
        (["kp", "kx"], r"chart row 2 column 2: unknown stitch; expected k, p, t, b, f, -; found 'x'", 1, 1),
        (["kp", "k"], r"chart row 2 has another length; expected 2 stitches as in row 1; found 1", 1, None),
        (["kb", "kt"], r"chart row 1 column 2: the wale is never knitted; .* found 'bt'", 0, 1),
        (["-b", "bf"], r"chart row 1 column 1: no needle knits", 0, 0),
        (["kt", "kt"], r"chart row 1 column 2: the wale is never knitted", 0, 1),
        (["kk", *["kt"] * 9], r"chart row 10 column 2: too many tucks on one loop; expected at most 8", 9, 1),
        (["kk", *["kb"] * 12], r"chart row 1 column 2: the loop is held too long; .* found 13", 0, 1),
        (["kk|p-", "k-|-k", "kk|pq"], r"chart row 3 back needle 2: unknown stitch", 2, 3),
        (["kk|p-", "kk|pt"], r"chart row 1 back needle 2: the wale is never knitted", 0, 3),
        (["kk|p"], r"chart row 1 has beds of different length", 0, None),
        (["kk|pp", "kk"], r"chart row 2 is for another number of needle beds", 1, None),
        (["k|p|k"], r"chart row 1 has too many needle beds", 0, None),
    ],
)
def test_faults_have_a_place(chart: list[str], message: str, row: int, column: int | None) -> None:
    with pytest.raises(ChartError, match=message) as caught:
        StitchChart.read(chart)
    assert (caught.value.row, caught.value.column) == (row, column)


def test_charts_have_a_size() -> None:
    for chart in ([], ["k"] * 65):
        with pytest.raises(InputError, match="chart has the wrong number of rows"):
            StitchChart.read(chart)
    with pytest.raises(InputError, match="chart row 1 is no row of stitches"):
        StitchChart.read(["k" * 65])

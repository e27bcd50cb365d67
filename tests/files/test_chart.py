"""Chart files: what they say is drawn, and every fault is answered with its place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

from yarnscale.drawing.knit import knit
from yarnscale.drawing.weave import weave
from yarnscale.errors import InputError
from yarnscale.files.chart import NUMBERS
from yarnscale.files.patterns import is_drawing, read_pattern, stitches_of, write_pattern
from yarnscale.yarn.clearance import closest_approach
from yarnscale.yarn.pattern import YarnPattern

DOCUMENTED = sorted((Path(__file__).resolve().parents[2] / "docs" / "charts").glob("*.chart"))
HEAD = "kind = knit\nwale_spacing = 9\ncourse_spacing = 5.5\n"


def write(folder: Path, text: str, name: str = "my.chart") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("path", DOCUMENTED, ids=lambda path: path.stem)
def test_documented_charts_are_drawn(path: Path) -> None:
    pattern = read_pattern(path)
    assert closest_approach(pattern).distance > 0.85 * 2 * pattern.radius


def test_the_documentation_has_charts() -> None:
    assert len(DOCUMENTED) >= 7


def test_rows_are_read_from_the_lowest_up(tmp_path: Path) -> None:
    path = write(tmp_path, HEAD + "name = mine\nradius = 0.5 mm\nrows:\n f p # a comment\nk k\n\np f\nkk\n")
    pattern = read_pattern(path)
    same = knit(["kk", "pf", "kk", "fp"], wale_spacing=9.0, course_spacing=5.5, radius=5e-4)
    assert pattern.name == "mine"
    assert pattern.content_hash() == same.content_hash()


def test_a_draft_is_woven_with_its_kinds_of_yarn(tmp_path: Path) -> None:
    text = "kind = weave\nwarp_spacing = 3.4\nwarp_yarns = B B\nrows:\n.x : A\nx. : C\n"
    pattern = read_pattern(write(tmp_path, text, "check.chart"))
    same = weave([[1, 0], [0, 1]], warp_spacing=3.4, weft_yarns="CA", warp_yarns="BB")
    assert pattern.name == "check"
    assert pattern.content_hash() == same.content_hash()
    assert pattern.yarn_material is not None
    assert pattern.yarn_material.tolist() == [2, 0, 1, 1]


def test_kinds_survive_the_native_format_only(tmp_path: Path) -> None:
    pattern = read_pattern(write(tmp_path, HEAD + "rows:\nk : AB\nk\n"))
    write_pattern(pattern, tmp_path / "plated.json")
    again = read_pattern(tmp_path / "plated.json")
    assert again.content_hash() == pattern.content_hash()
    assert np.array_equal(again.yarn_material, pattern.yarn_material)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="several yarn materials"):
        write_pattern(pattern, tmp_path / "plated.pyp")
    assert not (tmp_path / "plated.pyp").exists()


def test_a_chart_without_suffix_is_known_by_its_content(tmp_path: Path) -> None:
    path = write(tmp_path, "# mine\n" + HEAD + "rows:\nk\n", "mine")
    assert read_pattern(str(path)).name == "mine"


@pytest.mark.parametrize(
    ("text", "place", "message"),
    [
        (HEAD + "rows:\nkk\nkx\n", ":6:2", "chart row 1 column 2: unknown stitch; expected k, p, t, b, f, -"),
        (HEAD + "rows:\nk k\nk  q\n", ":6:4", "chart row 1 column 2: unknown stitch"),
        (HEAD + "rows:\nkkk\nkk\n", ":5", "chart row 2 has another length; expected 2 stitches as in row 1"),
        (HEAD + "rows:\nkf\n\nkt\n", ":7:2", "chart row 1 column 2: the wale is never knitted"),
        (
            HEAD + "rows:\n" + "kt\n" * 9 + "kk\n",
            ":5:2",
            "column 2: too many tucks on one loop; expected at most 8",
        ),
        (HEAD + "rows:\nkk|pp\nkk|-p\nkk | -\n", ":7", "chart row 1 has beds of different length"),
        (HEAD + "rows:\nk- | tp\nkk | -p\n", ":6:6", "chart row 1 back needle 1: the wale is never knitted"),
        (HEAD + "rows:\nkk : ABC\n", ":5:4", "row names no yarn"),
        (HEAD + "rows:\n: A\n", ":5", "row has no stitches"),
        (HEAD + "rows:\n", "", "chart has no rows"),
        (HEAD + "kk\n", ":4", "line is no setting; expected key = value, or rows:; found 'kk'"),
        ("rows:\nkk\n", "", "kind is missing"),
        ("kind = crochet\nrows:\nkk\n", ":1", "kind is unknown; expected knit or weave"),
        (HEAD + "kind = knit\nrows:\nk\n", ":4", "'kind' occurs twice; expected only line 1"),
        (HEAD + "warp_spacing = 3\nrows:\nk\n", ":4", "'warp_spacing': unknown key"),
        (HEAD + "radius = 1\nrows:\nk\n", ":4", "radius needs a number and a unit"),
        (HEAD + "radius = 1 tex\nrows:\nk\n", ":4", "radius needs a number and a unit"),
        (HEAD + "overhang = nan\nrows:\nk\n", ":4", "overhang is no positive number"),
        (HEAD + "overhang = 2\nrows:\nkt\nkk\n", ":2", "loop_height and overhang shape plain loops only"),
        ("kind = knit\nwale_spacing = 2.5\nrows:\nk\n", ":2", "overlap at this stitch size"),
        ("kind = weave\nrows:\nx.\n.k\n", ":4:2", "draft row 1 column 2: unknown symbol; expected x"),
        ("kind = weave\nrows:\nx.\n.\n", ":3", "draft row 2 has another length; expected 1 ends"),
        ("kind = weave\nrows:\nx.\nxx\n", ":4", "weft pick 1 never changes sides"),
        ("kind = weave\nrows:\n..x\n.x.\n", ":4:1", "warp end 1 never changes sides"),
        (
            "kind = weave\nrows:\n...x\n..x.\n.xxx\nx.xx\n",
            ":4",
            "weft pick 3, weft pick 4, warp end 3, warp end 4 lie at the top of all others",
        ),
        ("kind = weave\nwarp_yarns = ABC\nrows:\nx.\n.x\n", ":2", "warp_yarns has the wrong length"),
    ],
)
def test_faults_are_answered_with_their_place(tmp_path: Path, text: str, place: str, message: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(InputError) as caught:
        read_pattern(path)
    assert str(caught.value).startswith(f"{path}{place}: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "value", ["1e-300", "1e300", "1e-308", "0.01", "99999", "1e999", "nan", "inf", "0", "-1", "0x10"]
)
@pytest.mark.parametrize("key", [*NUMBERS["knit"], *NUMBERS["weave"], "radius"])
def test_numbers_of_any_size_are_answered_in_one_line(tmp_path: Path, key: str, value: str) -> None:
    kind = "knit" if key in NUMBERS["knit"] else "weave"
    rows = "k" if kind == "knit" else "x.\n.x"
    unit = " m" if key == "radius" else ""
    if (key, value) in (("radius", "0.01"), ("overhang", "0.01")):
        value = "1e-12"
    path = write(tmp_path, f"kind = {kind}\n{key} = {value}{unit}\nrows:\n{rows}\n")
    with pytest.raises(InputError) as caught:
        read_pattern(path)
    assert str(caught.value).startswith(f"{path}:2: {key} ") and "\n" not in str(caught.value)


MUDDLE = """kind = knit|kind = weave|rows:|kp|k-|k t|x.|.x|kk : A|: A|kk : AB|radius = 1 mm|radius = 1e999 mm|yarns = A|
wale_spacing = 9|course_spacing = 1e-300|tightness = 0.5|name = é|warp_yarns = A B|# c|loop_height = 1e5|k / p|///|
half_thickness = 9|vertices_per_stitch = 0.1|vertices_per_stitch = 20|kkk|x|*pattern|=|= 3"""
LINES = st.sampled_from([line.strip("\n").replace("/", "|") for line in MUDDLE.split("|")])


@seed(11)
@settings(max_examples=150, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(lines=st.lists(LINES, max_size=9), begin=st.sampled_from(["", "kind = knit\n", "kind = weave\n"]))
def test_any_lines_give_a_pattern_or_one_line(tmp_path: Path, lines: list[str], begin: str) -> None:
    """Nothing but an InputError of one line comes out of a muddled file."""
    middle = len(lines) // 3
    path = write(tmp_path, begin + "\n".join([*lines[:middle], "rows:", *lines[middle:]]))
    try:
        pattern = read_pattern(path)
    except InputError as error:
        assert str(error).startswith(str(path))
        assert "\n" not in str(error)
    else:
        assert isinstance(pattern, YarnPattern)


@seed(13)
@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(content=st.binary(max_size=200))
def test_any_bytes_give_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "any.chart"
    path.write_bytes(content)
    with pytest.raises(InputError):
        read_pattern(path)


def test_the_stitches_of_a_chart_begin_with_the_row_knitted_first(tmp_path: Path) -> None:
    path = write(tmp_path, HEAD + "rows:\nk k : b\nk t : b\np p : a\n")
    stitches = stitches_of(path)
    assert stitches is not None and stitches.rows == ("pp", "kt", "kk")
    assert len(read_pattern(path).yarns) == stitches.courses
    assert stitches_of(write(tmp_path, "kind = weave\nrows:\nx.\n.x\n", "weave.chart")) is None
    built = stitches_of("half-cardigan")
    assert built is not None and built.beds == 2 and built.rows == ("kp", "kt")
    assert stitches_of("plain") is None and stitches_of("elsewhere.pyp") is None
    with pytest.raises(InputError, match="symbols"):
        stitches_of(write(tmp_path, HEAD + "rows:\n", "empty.chart"))


def test_faults_of_stitches_are_told_by_their_place(tmp_path: Path) -> None:
    path = write(tmp_path, "kind = knit\nrows:\nk k\nk ?\n")
    told = []
    for reader in (read_pattern, stitches_of):
        with pytest.raises(InputError) as error:
            reader(path)
        told.append(str(error.value))
    assert told[0] == told[1] and f"{path}:4:3" in told[0]


def test_a_chart_without_a_suffix_is_one_by_its_content(tmp_path: Path) -> None:
    path = write(tmp_path, HEAD + "rows:\nkt\nkk\n", "nameless")
    stitches = stitches_of(path)
    assert stitches is not None and stitches.rows == ("kk", "kt")
    assert is_drawing(path) and len(read_pattern(path).yarns) == 2
    with pytest.raises(InputError, match="unknown pattern"):
        stitches_of("no-such-knit")

"""Knitout: one repeat of stitches between cast-on and bind-off, refusals with line and reason, and the way back."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from yarnscale.drawing import library
from yarnscale.drawing.knit import knit
from yarnscale.drawing.stitches import StitchChart
from yarnscale.errors import InputError, InputNotice
from yarnscale.files.patterns import read_pattern, stitches_of, structure_of, write_pattern

SHARED = Path(os.environ.get("YARNSCALE_SHARED", "shared")) / "files" / "knitout"
HEAD = [";!knitout-2", ";;Carriers: 1 2 3", "inhook 1"]
BIND_OFF = [line for n in range(8) for line in (f"knit - f{7 - n} 1", f"xfer f{7 - n} b{7 - n}", "rack 1")]


def passes(needles: list[str], direction: str, code: str = "knit", carrier: str = "1") -> list[str]:
    order = needles if direction == "+" else needles[::-1]
    return [f"{code} {direction} {needle} {carrier}" for needle in order if needle]


def piece(*rows: list[str], cast_on: list[str] | None = None, carriers: str = "") -> list[str]:
    """Tucks on every needle of the first rows, then the rows to and fro."""
    needles = sorted({n for row in rows for n in row}, key=lambda n: int(n[1:]))
    lines = HEAD + passes(needles[::2], "-", "tuck") + passes(needles[1::2], "+", "tuck")
    for number, row in enumerate(rows):
        lines += passes(row, "-+"[number % 2], carrier=(carriers or "1" * len(rows))[number])
    return lines


def write(folder: Path, lines: list[str] | bytes, name: str = "my.k") -> Path:
    path = folder / name
    path.write_bytes(lines if isinstance(lines, bytes) else ("\n".join(lines) + "\n").encode())
    return path


def rows_of(path: Path) -> tuple[str, ...]:
    structure = structure_of(path)
    assert structure is not None
    return structure.chart


FRONT, BACK = [f"f{n}" for n in range(8)], [f"b{n}" for n in range(8)]
BOTH = [needle for pair in zip(FRONT, BACK, strict=True) for needle in pair]
ODD_EVEN = [f"{'fb'[n % 2]}{n}" for n in range(8)]
EVEN_ODD = [f"{'bf'[n % 2]}{n}" for n in range(8)]
STRUCTURES = {
    "jersey": ([FRONT] * 5, ("k",)),
    "half-gauge jersey": ([FRONT[::2]] * 5, ("k",)),
    "reverse": ([BACK] * 4, ("p",)),
    "rib": ([ODD_EVEN] * 4, ("kp",)),
    "half-gauge rib": ([["f0", "b2", "f4", "b6"]] * 4, ("kp",)),
    "ladder": ([["f0", "f1", "f2", "f4", "f5", "f6"]] * 4, ("kkk-",)),
    "interlock": ([ODD_EVEN, EVEN_ODD] * 3, ("k-|-p", "-k|p-")),
    "Milano": ([BOTH, FRONT, BACK] * 3, ("k|p", "k|-", "-|p")),
    "all-needle": ([BOTH] * 3, ("k|p",)),
    "slips": ([FRONT, FRONT[::2], FRONT, FRONT[1::2]] * 3, ("kk", "kb", "kk", "bk")),
}


@pytest.mark.parametrize("name", STRUCTURES)
def test_the_repeat_is_found_between_cast_on_and_bind_off(tmp_path: Path, name: str) -> None:
    rows, chart = STRUCTURES[name]
    assert rows_of(write(tmp_path, piece(*rows))) == chart
    dropped = [f"drop {needle}" for needle in sorted({n for row in rows for n in row})]
    assert rows_of(write(tmp_path, piece(*rows) + BIND_OFF + dropped)) == chart


def test_setting_up_courses_are_left_off_with_a_notice(tmp_path: Path) -> None:
    rows = [FRONT, FRONT, FRONT, *([FRONT, FRONT[::2], FRONT, FRONT[1::2]] * 4), FRONT, FRONT]
    with pytest.warns(InputNotice, match="4 of 21 courses lie outside the repeat"):
        assert len(rows_of(write(tmp_path, piece(*rows)))) == 4


@pytest.mark.filterwarnings("ignore:.*left off")
def test_tucks_carriers_and_plated_yarns_are_drawn(tmp_path: Path) -> None:
    lines = piece(FRONT)
    for _ in range(3):
        lines += [*passes(FRONT, "+", carrier="2 1"), "miss + f9 2", "miss + f9 1"]
        lines += [f"{'knit' if n % 2 else 'tuck'} - f{n} 3" for n in range(7, -1, -1)]
    path = write(tmp_path, lines)
    structure = structure_of(path)
    assert structure is not None and sorted(structure.chart) == ["kk", "tk"]
    assert sorted(structure.sizes["yarns"]) == ["BA", "C"]
    pattern = read_pattern(path)
    assert pattern.yarn_material is not None and sorted(pattern.yarn_material.tolist()) == [0, 1, 2]


def test_racked_beds_face_each_other_one_needle_further(tmp_path: Path) -> None:
    shifted = [needle if needle[0] == "f" else f"b{int(needle[1:]) - 2}" for needle in BOTH]
    lines = [*HEAD, "rack 2.25", *passes(shifted, "-", "tuck")]
    assert rows_of(write(tmp_path, lines + (passes(shifted, "+") + passes(shifted, "-")) * 2)) == ("k|p",)


@pytest.mark.parametrize("name", [n for n in library.names() if not library.structure(n).woven])
def test_built_in_knits_come_back_from_knitout(tmp_path: Path, name: str) -> None:
    structure = library.structure(name)
    pattern = library.build("jersey")
    write_pattern(pattern, tmp_path / "my.k", structure=structure)
    assert StitchChart.read(structure.chart) == stitches_of(tmp_path / "my.k")


def test_yarns_floats_and_ladders_come_back_from_knitout(tmp_path: Path) -> None:
    rows = ["kk-kk", "kb-tk", "pp-kp", "kf-kk"]
    pattern = knit(rows, yarns=["A", "AB", "C", "B"], wale_spacing=9.0, course_spacing=6.0)
    structure = library.Structure("mine", tuple(rows), sizes={"yarns": ["A", "AB", "C", "B"]})
    write_pattern(pattern, tmp_path / "my.k", structure=structure)
    again = structure_of(tmp_path / "my.k")
    assert again is not None and again.chart == structure.chart and again.sizes["yarns"] == ["A", "AB", "C", "B"]
    write_pattern(pattern, tmp_path / "my.chart", structure=again)
    assert rows_of(tmp_path / "my.chart") == structure.chart
    twisted = library.Structure("mine", ("k|k",))
    with pytest.raises(InputError, match=r"my2\.k: chart row 1 back needle 1 needs a transfer to the other bed"):
        write_pattern(pattern, tmp_path / "my2.k", structure=twisted)
    assert not (tmp_path / "my2.k").exists()


LACE = [*piece(FRONT, FRONT), "xfer f3 b3", "rack 1", "xfer b3 f4", "rack 0", *passes(FRONT, "+")]
REFUSED = {
    "lace": (LACE, ":30: 'xfer b3 f4' moves a loop to another wale (a cable or lace)"),
    "stacked": ([*piece(BOTH, BOTH), "xfer f3 b3", *passes(BOTH, "-")], "puts a loop on a needle that holds one"),
    "two beds": (
        [*piece(BOTH, BOTH[1:]), "drop f0", "xfer b0 f0", *passes(["f0", *BOTH[2:]], "-")],
        "'drop f0' drops a loop",
    ),
    "changed beds": (
        [*piece(BOTH[1:], BOTH[1:]), "xfer b0 f0", *passes(["f0", *BOTH[2:]], "-")],
        "'xfer b0 f0' transfers; expected none where facing needles both hold loops",
    ),
    "split": ([*piece(FRONT, FRONT), "split + f3 b3 1", *passes(FRONT, "-")], ":28: 'split + f3 b3 1' splits"),
    "dropped": ([*piece(FRONT, FRONT), "drop f3", *passes(FRONT, "-")], ":28: 'drop f3' drops a loop"),
    "increase": ([*piece(FRONT, FRONT), *passes([*FRONT, "f8"], "-")], ":28: 'knit - f8 1' makes a loop on an"),
    "short row": (
        [*piece(FRONT, FRONT), *passes(FRONT[4:], "-"), *passes(FRONT[4:], "+"), *passes(FRONT, "-")],
        ":28: 'knit - f7 1' begins a course of needles 4 to 7 of 0 to 7 (short row or intarsia)",
    ),
    "intarsia": (
        piece(FRONT) + (passes(FRONT[:4], "+") + passes(FRONT[4:], "+", carrier="2")) + passes(FRONT, "-"),
        "(short row or intarsia)",
    ),
    "intarsia only": (
        piece(FRONT)[:11] + (passes(FRONT[:4], "+") + passes(FRONT[4:], "+", carrier="2")) * 3,
        ":32: 'knit + f4 2' begins a course of needles 4 to 7 of 0 to 7",
    ),
    "racked": ([*piece(BOTH, BOTH), "rack 1", *passes(BOTH, "-"), "rack 0", *passes(BOTH, "+")], "racked by 1"),
    "tube": (piece(*[FRONT, BACK] * 4), "front and back are two layers; expected a course that knits on both"),
    "half-gauge tube": (piece(*[FRONT[::2], BACK[1::2]] * 4), "front and back are two layers"),
    "slider": ([*piece(FRONT, FRONT), "xfer f3 bs3", *passes(FRONT, "-")], "moves a loop to a slider"),
    "three yarns": ([*piece(FRONT, FRONT), *passes(FRONT, "-", carrier="1 2 3"), *passes(FRONT, "+")], "two yarns"),
    "never knitted": (
        [*HEAD, *passes(FRONT, "-", "tuck"), *passes(FRONT[:3], "+"), "tuck + f3 1", *passes(FRONT[4:], "+")],
        "column 4: the wale is never knitted",
    ),
    "no fabric": (HEAD + passes(FRONT, "-", "tuck"), ": file knits no fabric"),
    "opcode": ([*HEAD, "knot + f1 1"], ":4: unknown instruction; expected knit, tuck"),
    "no needle": ([*HEAD, "knit + g1 1"], ":4: bad instruction; expected as in knit + f1 1; found 'knit + g1 1'"),
    "huge needle": ([*HEAD, "knit + f1000000000 1"], ":4: bad instruction"),
    "far needle": ([*HEAD, "knit + f9999 1"], ":4: bad instruction"),
    "no direction": ([*HEAD, "knit f1 1"], ":4: bad instruction; expected as in knit + f1"),
    "cut off": ([*HEAD, "knit +"], ":4: bad instruction"),
    "half a transfer": ([*HEAD, "xfer f1"], ":4: bad instruction; expected as in xfer f1 b1"),
    "carrier": ([*HEAD, "knit + f1 9"], ":4: unknown carrier; expected one of ;;Carriers: 1 2 3"),
    "rack": ([*HEAD, "rack left"], ":4: bad instruction; expected as in rack 1; found 'rack left'"),
    "no repeat": (
        piece(*[[f"f{n}" for n in range(8) if row == "1" * 8 or row[n] == "1"] for row in
                [f"{(37 * i * i + 11 * i) % 251 | 129:08b}" for i in range(150)]]),
        "courses have no repeat; expected one of at most 64",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_drawn_is_refused_with_line_and_reason(tmp_path: Path, case: str) -> None:
    lines, message = REFUSED[case]
    path = write(tmp_path, lines)
    with pytest.raises(InputError) as caught:
        read_pattern(path)
    told = str(caught.value)
    assert told.startswith(str(path)) and message in told and "\n" not in told


@pytest.mark.parametrize("content", [b"", b";!knitout-2\n\0\1", b"\xff\xfek\0n", np.random.default_rng(1).bytes(300)])
def test_other_files_are_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(InputError, match=r"my\.k"):
        read_pattern(write(tmp_path, content))


def test_a_file_is_known_by_its_first_line(tmp_path: Path) -> None:
    text = "\ufeff" + "\r\n".join([*piece(FRONT, FRONT), "; Gr\u00f6\u00dfe", "x-speed-number 3", "stitch 1 2"])
    assert rows_of(write(tmp_path, text.encode(), "nameless")) == ("k",)
    assert rows_of(write(tmp_path, text.removeprefix("\ufeff").encode("latin-1"))) == ("k",)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("stst_square", ("k",)),
        ("rib", ("kp",)),
        ("jacquard", ("kkkk|----", "----|pppp", "--kk|pp--", "kk--|--pp")),
        ("mix_knit_tuck", "never knitted"),
        ("cable", "k:17: 'xfer b3 f1' moves a loop to another wale"),
        ("lace", "k:16: 'xfer b3 f2' moves a loop to another wale"),
    ],
)
def test_files_of_other_programs(name: str, expected: tuple[str, ...] | str) -> None:
    path = SHARED / f"{name}.k"
    if not path.exists():
        pytest.skip("the shared knitout files are not here")
    if isinstance(expected, str):
        with pytest.raises(InputError, match=expected):
            stitches_of(path)
    else:
        assert rows_of(path) == expected

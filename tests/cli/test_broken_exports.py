"""Broken exports of testing machines: ``estimate`` says in one line where the fault is, and writes nothing."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

HEADER = "direction,run,force_N,clamp_distance_mm,mid_width_mm,swatch_width_mm"
LENGTH = (100.0, 103.5, 105.0, 107.1, 108.7)
ROWS = [
    f"weft,{run},{force},{length + run},{60 - 2 * force},60"
    for run in (1, 2)
    for force, length in zip((0.0, 0.5, 1.0, 2.0, 3.0), LENGTH, strict=True)
]
NAMES = "Extension (mm),Load (N)\n"
LOG = NAMES + "".join(f"{5 * k},{0.1 * k * k:.1f}\n" for k in range(12))
SWATCH = ("--swatch", "100x50")


def table(rows: list[str], header: str = HEADER) -> str:
    return "\n".join([header, *rows]) + "\n"


def cell(old: str, new: str) -> str:
    """The table with another cell in the third reading, line 4."""
    assert old in ROWS[2]
    return table([*ROWS[:2], ROWS[2].replace(old, new), *ROWS[3:]])


def log(form: Callable[[int], str], names: str = NAMES) -> str:
    return "weft\n" + names + "".join(form(k) + "\n" for k in range(12))


def u3m(**changed: object) -> bytes:
    """An archive with a small file of the format whose strip along the width is changed, or its schema."""
    loading = [[8.0, 0, 8.5, 5, 9, 20, 9.5, 50], [9.5, 50, 9, 10, 8, 0]]
    strip = {"width": 4, "length": 8.0, "samplesTree": loading}
    raw = {"L": {"S2": strip}, "W": {"S2": {**strip, **changed}}, "M": 210}
    text = json.dumps({"schema": changed.get("schema", "1.1"), "raw_data": raw}, indent=1)
    return archive({"physics.json": text.encode()})


def archive(files: dict[str, bytes]) -> bytes:
    kept = io.BytesIO()
    with zipfile.ZipFile(kept, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in files.items():
            file.writestr(name, content)
    return kept.getvalue()


def workbook(*rows: list[object]) -> bytes:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    book.save(kept := io.BytesIO())
    return kept.getvalue()


def without(column: str) -> str:
    lines: list[list[str]] = [line.split(",") for line in [HEADER, *ROWS]]
    place = lines[0].index(column)
    return "\n".join(",".join(cells[:place] + cells[place + 1 :]) for cells in lines)


GRAMS = [row.replace(row.split(",")[2], str(102 * float(row.split(",")[2])), 1) for row in ROWS]
METRES = [",".join([*row.split(",")[:3], str(float(row.split(",")[3]) / 1e3), *row.split(",")[4:]]) for row in ROWS]
PICTURE = b"\x89PNG\r\n\x1a\n" + bytes(range(256))

BROKEN = {
    "no force": ("a.csv", without("force_N"), (":1:", "column force is missing", "found direction, run")),
    "no run": ("a.csv", without("run"), (":1:", "column run is missing")),
    "no direction": ("a.csv", LOG, (":1:", "column direction is missing", "[[stretch]]"), SWATCH),
    "units of length": (
        "a.csv",
        table(ROWS, HEADER.replace("swatch_width_mm", "swatch_width_cm")),
        (":1:", "mixed units of length", "clamp_distance_mm and swatch_width_cm"),
    ),
    "one run in metres": (
        "a.csv",
        table([*ROWS[:5], *METRES[5:]]),
        (":7:", "clamp_distance_mm", "mixed units?"),
    ),
    "no unit": (
        "a.csv",
        log(lambda k: f"{5 * k},{k}", "Extension (mm),Load\n"),
        (":2:", "unit", "'Load'"),
        SWATCH,
    ),
    "MPa": ("a.csv", log(lambda k: f"{5 * k},{k}", "Extension (mm),Load (MPa)\n"), (":2:", "'MPa'"), SWATCH),
    "text": ("a.csv", cell("1.0", "one"), (":4:", "force_N", "a number alone", "'one'")),
    "unit in a cell": ("a.csv", cell("1.0", "1.0 N"), (":4:", "force_N", "'1.0 N'")),
    "empty cell": ("a.csv", cell("1.0", ""), (":4:", "force_N", "''")),
    "formula": ("a.csv", cell("1.0", "#DIV/0!"), (":4:", "force_N", "'#DIV/0!'")),
    "nan": ("a.csv", cell("1.0", "NaN"), (":4:", "force_N", "'NaN'")),
    "inf": ("a.csv", cell("1.0", "-inf"), (":4:", "force_N", "'-inf'")),
    "overflow": ("a.csv", cell("1.0", "1e999"), (":4:", "force_N", "'1e999'")),
    "missing cells": ("a.csv", cell("weft,1,1.0", "1.0"), (":4:", "expected 6 cells; found 4")),
    "too many cells": ("a.csv", cell("1.0", "1,0"), (":4:", "6 cells; found 7, decimal commas")),
    "quotation mark": ("a.csv", cell("weft", '"weft'), (":4:", "quotation mark", "found none")),
    "direction": ("a.csv", cell("weft", "left"), (":4:", "direction", "weft, bias or warp", "'left'")),
    "specimen below": (
        "a.csv",
        "Specimen 1 - weft\n" + LOG + "Specimen 2 - weft\n" + NAMES + "Specimen 3 - weft\n" + LOG,
        (":16:", "'Specimen 2 - weft'", "readings below", "found none"),
        SWATCH,
    ),
    "specimen beside": (
        "a.csv",
        "weft 1,,weft 2,\n" + 2 * "Extension (mm),Load (N)," + "\n0,0,,\n5,1,,\n9,2,,\n",
        (":2:", "specimen 'weft 2'", "found none"),
        SWATCH,
    ),
    "falling length": (
        "a.csv",
        log(lambda k: f"{55 - 5 * k},{k}"),
        (":3:", "a force that grows while the length falls"),
        SWATCH,
    ),
    "shrinking": ("a.csv", log(lambda k: f"{-5 * k},{k}"), (":14:", "Extension (mm)", "-0.055"), SWATCH),
    "unloading": (
        "a.csv",
        log(lambda k: f"{55 - 5 * k},{11 - k}"),
        (":3:", "loading of run 'weft'", "found 1"),
        SWATCH,
    ),
    "one force": ("a.csv", log(lambda k: f"{5 * k},3"), (":3:", "12 readings of one force"), SWATCH),
    "one length": ("a.csv", log(lambda k: f"5,{k}"), (":3:", "12 readings of one length"), SWATCH),
    "compression": (
        "a.csv",
        log(lambda k: f"{5 * k},{-k}"),
        (":14:", "Load (N)", "tension", "-11 N"),
        SWATCH,
    ),
    "grams": ("a.csv", table(GRAMS), (":2:", "grams taken for newtons")),
    "kilonewtons": ("a.csv", table(ROWS, HEADER.replace("_N", "_kN")), (":2:", "grams taken for newtons")),
    "millinewtons": (
        "a.csv",
        table(ROWS, HEADER.replace("_N", "_mN")),
        ("a, weft", "0.05 N/m", "newtons taken for grams"),
    ),
    "strain": (
        "a.csv",
        log(lambda k: f"{5 * k},{k}", "Strain (1),Load (N)\n"),
        (":14:", "a strain in percent"),
        SWATCH,
    ),
    "no gauge": (
        "a.csv",
        "Specimen width,50,mm\nweft\n" + LOG,
        (":3:", "swatch_length", "--swatch LENGTHxWIDTH"),
    ),
    "no width": (
        "a.csv",
        "Gauge length,100,mm\nweft\n" + LOG,
        (":3:", "swatch_width", "--swatch LENGTHxWIDTH"),
    ),
    "width of zero": (
        "a.csv",
        "Specimen width,0,mm\nweft\n" + LOG,
        (":1:", "'Specimen width'", "above zero", "found 0"),
    ),
    "width below zero": ("a.csv", cell(",60", ",-60"), (":4:", "swatch_width_mm", "more than zero", "'-60'")),
    "two widths": ("a.csv", cell(",60", ",61"), (":4:", "swatch_width_mm", "one size", "0.061 m")),
    "width of the middle": (
        "a.csv",
        table([row.replace(",60.0,", ",6.0,") for row in ROWS]),
        (":2:", "mid_width_mm", "0.006 m"),
    ),
    "widths of blocks": (
        "a.csv",
        "".join(
            f"Specimen {k} weft\nSpecimen width,{w},mm\nGauge length,100,mm\n" + LOG for k, w in enumerate((50, 25, 90))
        ),
        (":21:", "swatches of about one width along weft, 0.055 m", "0.025 m"),
    ),
    "columns of blocks": (
        "a.csv",
        "weft 1\n" + LOG + "weft 2\nTime (s),Extension (mm),Load (N)\n1,2\n2,3\n3,4\n",
        (":17:", "expected 3 cells; found 2"),
        SWATCH,
    ),
    "two names": (
        "a.csv",
        table(ROWS, HEADER.replace("mid_width_mm", "force_N")),
        (":1:", "'force_N'", "one column"),
    ),
    "two forces": (
        "a.csv",
        log(lambda k: f"{5 * k},{k},{2 * k}", "Extension (mm),Load (N),Force (N)\n"),
        (":4:", "'Force (N)'", "'Load (N)'", "found 2 N"),
        SWATCH,
    ),
    "decimal marks": (
        "a.csv",
        "weft\nExtension (mm);Load (N)\n0,5;0\n5.5;1\n9,5;2\n",
        (":4:", "decimal marks", "'0,5' and '5.5'"),
        SWATCH,
    ),
    "commas": (
        "a.csv",
        log(lambda k: f"{5 * k},5,{k},1"),
        (":3:", "decimal commas where commas separate columns"),
        SWATCH,
    ),
    "one row": ("a.csv", table(ROWS[:1]), (":2:", "three readings or more", "found 1")),
    "names alone": ("a.csv", HEADER + "\n", (":1:", "readings", "found none")),
    "no table": ("a.csv", "<svg xmlns='http://www.w3.org/2000/svg'/>\n", (":1:", "column names", "<svg")),
    "picture": ("a.csv", PICTURE, ("file is not text",)),
    "other letters": ("a.csv", table(ROWS).encode("cp500"), (":1:", "UTF-8, UTF-16 or Windows-1252", "0x84")),
    "UTF-32": ("a.csv", table(ROWS).encode("utf-32"), ("file is not text",)),
    "empty": ("a.csv", b"", ("file is empty",)),
    "long line": ("a.csv", table(ROWS).encode() + b"1," * 1_000_000, (":12:", "≤ 1000000 characters")),
    "workbook as text": ("a.csv", archive({"x": b""}), ("spreadsheet or archive", "CSV")),
    "text as workbook": ("a.xlsx", table(ROWS), ("file is no workbook",)),
    "schema": ("a.u3m", u3m(schema="2.0"), ("a.u3m[physics.json]:2:", "field 'schema'", "'1.1'", "'2.0'")),
    "pairs": (
        "a.u3m",
        u3m(samplesTree=[[8.0, 1, 9]]),
        ("raw_data.W.S2.samplesTree[0]", "pairs", "3 numbers"),
    ),
    "strip": ("a.u3m", u3m(width=-4), ("raw_data.W.S2.width", "a positive number", "-4")),
    "strip in grams": (
        "a.u3m",
        u3m(samplesTree=[[8, 0, 8.5, 5e3, 9, 2e4, 9.5, 5e4]]),
        ("W.S2.samplesTree", "490 N: grams taken"),
    ),
    "archive cut off": ("a.u3m", u3m()[:200], ("archive is cut off",)),
    "archive damaged": ("a.u3m", u3m()[:-30], ("archive is cut off",)),
    "archive of pictures": ("a.u3m", archive({"a.png": PICTURE}), ("no measurements", "a JSON file")),
    "zip bomb": (
        "a.u3m",
        archive({"a.json": b'"raw_data"' + b" " * 70_000_000}),
        ("file is too large", "≤ 67108864 bytes"),
    ),
    "summary values": (
        "a.json",
        '{"custom": {"browzwear": {"bend": {"length": 16}, "stretch": {"length": 72}}}}',
        ("raw_data", "summary values in 'custom.browzwear'", "not published"),
    ),
    "presets": (
        "a.zfab",
        archive({"a.fab": b"1"}),
        ("fabric of CLO", "a table of readings", "not published"),
    ),
    "no archive": ("a.u3m", PICTURE, ("file is not text",)),
    "no file": ("a.toml", "stretch = 'b.csv'\n", ("b.csv: file does not exist",)),
}
"""Kind → name of the file, content, words of the error, options."""


@pytest.mark.parametrize("kind", BROKEN)
def test_broken_exports(refused, tmp_path: Path, kind: str) -> None:
    name, content, words, *options = BROKEN[kind]
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    line = refused("estimate", path, "--pattern", "stockinette", "--out", tmp_path / "out", *(options or [[]])[0])
    assert [word for word in words if word not in line] == []
    if "file does not exist" not in line and "N/m" not in line:
        assert str(path) in line
    assert sorted(file.name for file in tmp_path.iterdir()) == [name]


def test_a_workbook_without_a_known_sheet_and_a_folder(refused, tmp_path: Path) -> None:
    path = tmp_path / "a.xlsx"
    path.write_bytes(workbook(["Customer", "none"], ["a", 1]))
    start = ("--pattern", "stockinette", "--out", tmp_path / "out")
    assert f"{path}[Sheet]:1: column names" in refused("estimate", path, *start)
    assert "no table" not in refused("estimate", tmp_path, *start)

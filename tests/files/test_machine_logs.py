"""Logs as testing machines write them: separators, decimal marks, units, encodings, titles, several specimens."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.files.measurements import read_measurements
from yarnscale.files.measurements_swatches import LogSettings
from yarnscale.swatches.measurements import Direction

SWATCH = LogSettings(swatch_width=0.05, swatch_length=0.1)
STRETCH = np.linspace(0.0, 0.4, 81)


def force_of(stretch):
    return 0.4 * (np.exp(5.0 * stretch) - 1.0)


def comma(value: float, digits: int = 4) -> str:
    return f"{value:.{digits}f}".replace(".", ",")


def fabric_of(folder: Path, content: str | bytes, *, name: str = "weft-1.csv", settings: LogSettings | None = SWATCH):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_measurements(path, settings=settings)


def check(fabric, *, direction=Direction.WEFT, runs=1) -> None:
    """The known curve."""
    (test,) = fabric.stretch
    assert test.direction is direction and len(test.runs) == runs
    assert test.swatch_width == pytest.approx(0.05) and test.swatch_length == pytest.approx(0.1, rel=1e-3)
    curve = test.curve
    assert curve.load[-1] > 45
    np.testing.assert_allclose(
        np.interp(STRETCH[10:60], curve.stretch, curve.load), force_of(STRETCH[10:60]) / 0.05, rtol=0.01
    )


def rows(form, *, stretch=STRETCH) -> str:
    return "\n".join(form(s, force_of(s)) for s in stretch) + "\n"


def test_instron_specimens_below_each_other(tmp_path):
    text = '"Sample ID","jersey"\n"Method","strip"\n\n'
    for k in (1, 2):
        text += f'"Specimen {k} - wale"\n"Time","Extension","Load","Tensile strain"\n"(s)","(mm)","(N)","(%)"\n'
        text += rows(lambda s, f: f'"{600 * s:.2f}","{100 * s:.4f}","{f:.4f}","{100 * s:.4f}"')
        text += '"Mean","12.0","1.1","30"\n\n'
    fabric = fabric_of(tmp_path, text, name="log.csv")
    check(fabric, direction=Direction.WARP, runs=2)
    assert [run.name for run in fabric.stretch[0].runs] == ["Specimen 1 - wale", "Specimen 2 - wale"]


def test_zwick_semicolons_decimal_commas_latin_1_and_a_line_of_units(tmp_path):
    text = "Prüfer;Müller\nPrüfrichtung;Schuss\n\nStandardweg;Standardkraft;Prüfzeit\nmm;N;s\n"
    text += rows(lambda s, f: f"{comma(100 * s)};{comma(f)};{comma(600 * s, 1)}")
    check(fabric_of(tmp_path, text.encode("latin-1"), name="log.csv"))


def test_shimadzu_units_below_names_and_force_first(tmp_path):
    text = "1 _ 1\nTime,Force,Stroke\nsec,N,mm\n" + rows(lambda s, f: f"{s},{f:.4f},{100 * s:.4f}")
    check(fabric_of(tmp_path, text))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"])
def test_encodings(tmp_path, encoding):
    text = "Längenänderung [mm]\tPrüfkraft [N]\r\n" + rows(lambda s, f: f"{100 * s:.4f}\t{f:.4f}").replace("\n", "\r\n")
    check(fabric_of(tmp_path, text.encode(encoding)))


@pytest.mark.parametrize(
    ("header", "form"),
    [
        ("Load (N),Extension (mm)", lambda s, f: f"{f:.4f},{100 * s:.4f}"),
        ("Extension mm,Load N", lambda s, f: f"{100 * s:.4f},{f:.4f}"),
        ("Kraft in cN;Weg in cm", lambda s, f: f"{comma(100 * f)};{comma(10 * s)}"),
        ("Dehnung [%];Kraft [mN]", lambda s, f: f"{comma(100 * s)};{comma(1000 * f)}"),
        ("Tensile strain (Extension) (%),Load (kgf)", lambda s, f: f"{100 * s:.4f},{f / 9.80665:.7f}"),
        ("Strain [mm/mm]\tForce [kN]", lambda s, f: f"{s:.6f}\t{f / 1000:.8f}"),
        ("Force per width [N/m],Strain [%]", lambda s, f: f"{f / 0.05:.4f},{100 * s:.4f}"),
        ("Weg [µm];Kraft [mN]", lambda s, f: f"{1e5 * s:,.1f};{1e3 * f:,.1f}".replace(",", "'")),
        (
            "Weg [µm];Kraft [mN]",
            lambda s, f: f"{1e5 * s:,.1f};{1e3 * f:,.1f}".replace(",", " ").replace(".", ","),
        ),
        ("Load 1 (N),Extension 1 (mm)", lambda s, f: f"{f:.4f},{100 * s:.4f}"),
        ("試験力(N),ストローク(mm)", lambda s, f: f"{f:.4f},{100 * s:.4f}"),
        ("Extension(mm)   Load(N)", lambda s, f: f"{100 * s:10.4f}   {f:10.4f}"),
        ("Grip separation / mm,Force / N", lambda s, f: f"{100 * (1 + s):.4f},{f:.4f}"),
        ("Crosshead displacement (mm);Last (N)", lambda s, f: f'"{comma(100 * s)}";"{comma(f)}"'),
        ('"Extension (mm)","Load (mN)"', lambda s, f: f'"{100 * s:.4f}","{1000 * f:,.2f}"'),
        (
            "Weg [µm];Kraft [mN]",
            lambda s, f: f"{1e5 * s:,.1f};{1e3 * f:,.1f}".translate(str.maketrans(",.", ".,")),
        ),
    ],
)
def test_names_units_and_numbers(tmp_path, header, form):
    check(fabric_of(tmp_path, header + "\n" + rows(form)))


def test_specimens_side_by_side(tmp_path):
    text = "course 1,,course 2,\nExtension,Load,Extension,Load\n(mm),(N),(mm),(N)\n"
    for k, s in enumerate(STRETCH):
        second = f"{100 * s:.4f},{force_of(s):.4f}" if k < 79 else ","
        text += f"{100 * s:.4f},{force_of(s):.4f},{second}\n"
    check(fabric_of(tmp_path, text, name="log.csv"), runs=2)


def test_several_swatches_in_one_column(tmp_path):
    text = "Sample;Extension (mm);Load (N)\n"
    text += "".join(rows(lambda s, f, k=k: f"{k};{comma(100 * s)};{comma(f)}") for k in (1, 2, 3))
    check(fabric_of(tmp_path, text), runs=3)


def test_sizes_above_the_table(tmp_path):
    text = "Gauge length;100;mm\nSpecimen width: ;50,0 mm\nDirection: weft\nExtension (mm);Load (N)\n"
    check(fabric_of(tmp_path, text + rows(lambda s, f: f"{comma(100 * s)};{comma(f)}"), name="log.csv", settings=None))


def test_the_construction_of_the_fabric_above_the_table(tmp_path):
    text = (
        "Maschenstäbchen/cm;14\nCourses per cm: ;20,5\nLoop length;2,9;mm\nTex;19,7\nFlächengewicht [g/m²];165\n"
        "Specimen 1 - weft\nStrain %;Force (N/5cm);Width (mm);Gauge length (mm)\n"
    )
    fabric = fabric_of(
        tmp_path,
        text + rows(lambda s, f: f"{comma(100 * s)};{comma(f)};50;100"),
        name="log.csv",
        settings=None,
    )
    check(fabric)
    known = fabric.known
    assert (known.wales, known.courses, known.loop_length) == pytest.approx((1400, 2050, 2.9e-3))
    assert known.yarn_count == fabric.yarn_count == pytest.approx(19.7e-6)
    assert fabric.area_density == pytest.approx(0.165)


def test_sheets_of_a_workbook(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.title = "Summary"
    book.active.append(["Customer", "none"])
    for name in ("weft 1", "weft 2"):
        sheet = book.create_sheet(name)
        for row in (
            ["Extension", "Load"],
            ["mm", "cN"],
            *([100 * s, 100 * force_of(s)] for s in STRETCH.tolist()),
        ):
            sheet.append(row)
    book.save(tmp_path / "log.xlsx")
    check(read_measurements(tmp_path / "log.xlsx", settings=SWATCH), runs=2)
    sheet["B9"] = "none"
    book.save(tmp_path / "log.xlsx")
    with pytest.raises(InputError, match=r"log.xlsx\[weft 2\]:9: column 'Load'"):
        read_measurements(tmp_path / "log.xlsx", settings=SWATCH)
    (tmp_path / "bad.xlsx").write_bytes(b"PK\x03\x04 no archive")
    with pytest.raises(InputError, match="no workbook"):
        read_measurements(tmp_path / "bad.xlsx", settings=SWATCH)


def test_sizes_in_a_sentence_above_the_table(tmp_path):
    text = '"Method","strip 50 mm, gauge 100 mm, 100 mm/min"\n"Specimen 1 - weft"\n' + GOOD
    fabric = fabric_of(tmp_path, text, name="log.csv", settings=None)
    check(fabric)
    assert "swatch width 50 mm, as line 1 says" in " | ".join(fabric.notes)


def test_one_file_a_specimen(tmp_path):
    for k in (1, 2):
        (tmp_path / f"log{k}.txt").write_text("Extension (mm),Load (N)\n" + rows(lambda s, f: f"{100 * s:.4f},{f:.4f}"))
    text = "".join(
        f'[[stretch]]\nfile = "log{k}.txt"\ndirection = "weft"\nswatch_width_mm = 50\nswatch_length_mm = 100\n'
        for k in (1, 2)
    )
    check(fabric_of(tmp_path, text, name="fabric.toml", settings=None), runs=2)


@pytest.mark.parametrize("readings", [40, 400, 40_000])
def test_sampling_rate_noise_slack_and_offset(tmp_path, readings):
    random = np.random.default_rng(1)
    stretch = np.linspace(-0.1, 0.4, readings)
    force = force_of(np.maximum(stretch, 0)) + 0.08 + 0.004 * random.normal(size=readings)
    text = "Extension (mm),Load (N)\n" + "".join(
        f"{100 * s + 10:.5f},{f:.5f}\n" for s, f in zip(stretch, force, strict=True)
    )
    fabric = fabric_of(tmp_path, text, settings=LogSettings(swatch_width=0.05, swatch_length=0.09))
    (test,) = fabric.stretch
    assert test.swatch_length == pytest.approx(0.1, rel=0.01)
    assert len(test.runs[0].force) <= 202
    load = np.interp(STRETCH[10:60], test.curve.stretch, test.curve.load)
    slope = 5.0 * (force_of(STRETCH[10:60]) + 0.4)
    assert np.abs((0.05 * load - force_of(STRETCH[10:60])) / slope).max() < 0.013
    assert any("slack" in note for note in fabric.notes)


def test_results_below_the_readings_are_no_readings(tmp_path):
    text = "Extension (mm),Load (N)\n" + rows(lambda s, f: f"{100 * s:.4f},{f:.4f}")
    check(fabric_of(tmp_path, text + "\nResults\nMaximum load,12.5\nSpecimen,Max load (N)\n1,12.5\n"))


def test_what_is_left_out_is_said(tmp_path):
    text = "Extension (mm),Load (N),Humidity\n" + rows(
        lambda s, f: f"{100 * s:.4f},{f:.4f},65", stretch=np.concatenate([STRETCH, STRETCH[::-1]])
    )
    fabric = fabric_of(tmp_path, text)
    check(fabric)
    notes = " | ".join(fabric.notes)
    for word in ("Humidity", "readings after the loading", "one run only"):
        assert word in notes


FALLING = "Extension (mm),Load (N)\n" + rows(lambda s, f: f"{40 - 100 * s:.4f},{f:.4f}")
GOOD = "Extension (mm),Load (N)\n" + rows(lambda s, f: f"{100 * s:.4f},{f:.4f}")


@pytest.mark.parametrize(
    ("content", "settings", "words"),
    [
        (GOOD, None, (":1", "swatch_width", "swatch_width_mm", "--swatch")),
        (GOOD, LogSettings(swatch_width=0.05), (":1", "swatch_length", "--swatch")),
        (GOOD.replace("(N)", ""), SWATCH, (":1", "unit", "Load", "none")),
        (GOOD.replace("(N)", "(MPa)"), SWATCH, (":1", "unit", "MPa", "N/m")),
        (GOOD.replace("Load (N)", "Torque (Nm)"), SWATCH, (":1", "Torque", "Load (N)")),
        (GOOD.replace("Extension (mm)", "Temperature"), SWATCH, (":1", "Temperature")),
        (GOOD.replace("Extension (mm)", "Strain"), SWATCH, (":1", "unit", "Strain", "%")),
        (GOOD.replace("\n5.0000,", "\n5.0.0,"), SWATCH, (":12", "Extension", "5.0.0")),
        (GOOD.replace("\n5.0000,", "\n5 .0000,"), SWATCH, (":12", "Extension", "5 .0000")),
        (GOOD.replace("\n5.0000,", "\n5,0000,"), SWATCH, (":12", "2 cells", "decimal commas")),
        (GOOD.replace("\n5.0000,", '\n"5,0000",'), SWATCH, ("decimal marks", "5,0000")),
        (GOOD.replace("Extension (mm)", "Strain [1]"), SWATCH, (":82", "Strain [1]", "percent")),
        (GOOD.replace(",", ",-"), SWATCH, ("Load", "positive")),
        ("A 1\n" + GOOD + "A 2\nExtension (mm),Load (N)\nA 3\n" + GOOD, SWATCH, (":85", "'A 2'", "readings below")),
        ("1,,2,\n" + 2 * "Extension (mm),Load (N)," + "\n0,0,,\n1,1,,\n2,2,,\n", SWATCH, (":2", "specimen '2'")),
        (GOOD.replace("(N)", "(kN)"), SWATCH, ("grams taken for newtons",)),
        (FALLING, SWATCH, (":2", "length falls")),
        ("no,log\nat,all\n", SWATCH, (":1", "column names", "no, log")),
        ("Extension (mm),Load (N)\n", SWATCH, ("readings", "none")),
        (b"PK\x03\x04" + 50 * b"\0", SWATCH, ("spreadsheet", "CSV")),
        ("Weg [mm];Kraft\x81 [N]\n0;1\n".encode("latin-1"), SWATCH, (":1", "Windows-1252", "0x81")),
    ],
)  # fmt: skip
def test_refusals_say_what_to_do(tmp_path, content, settings, words):
    with pytest.raises(InputError) as caught:
        fabric_of(tmp_path, content, settings=settings)
    said = str(caught.value)
    assert "weft-1.csv" in said and "\n" not in said
    for word in words:
        assert word in said


@pytest.mark.parametrize("name", ["warp", "Wales", "walewise", "90°", "Kette", "length-wise"])
def test_names_of_directions(tmp_path, name):
    text = "Direction,Specimen,Extension (mm),Load (N)\n" + rows(lambda s, f: f"{name},1,{100 * s:.4f},{f:.4f}")
    if name == "Wales":
        text = f"{name}\n" + GOOD
    if name == "length-wise":
        with pytest.raises(InputError, match="weft, bias or warp"):
            fabric_of(tmp_path, text)
        return
    check(fabric_of(tmp_path, text, name="log.csv"), direction=Direction.WARP)


def test_an_unknown_direction_is_asked_for(tmp_path):
    with pytest.raises(InputError, match=r"log\.csv:1: column direction is missing.*\[\[stretch\]\]"):
        fabric_of(tmp_path, GOOD, name="log.csv")


@pytest.mark.parametrize(
    ("entry", "word"),
    [
        ('file = "log.csv"\nwidth = 50', "stretch.width"),
        ('file = "log.csv"\nswatch_width_mm = -5', "swatch_width_mm"),
        ('file = "log.csv"\ndirection = "up"', "weft, bias or warp"),
        ('file = "log.csv"\ncycle = "third"', "first or last"),
        ("swatch_width_mm = 5", "file"),
    ],
)
def test_faults_of_stretch_tables_are_told(tmp_path, entry, word):
    with pytest.raises(InputError, match=r"fabric\.toml") as caught:
        fabric_of(tmp_path, f"[[stretch]]\n{entry}\n", name="fabric.toml")
    assert word in str(caught.value)


def cut(*pieces, notes, header="Extension (mm),Load (N)\n", time: bool = False) -> str:
    """A log of pieces of stretch, a line of text before each."""
    text, clock = header, 0.0
    for note, piece in zip(notes, pieces, strict=True):
        text += note
        for s in piece:
            clock += 0.1
            text += (f"{clock:.1f}," if time else "") + f"{100 * s:.4f},{force_of(s):.4f}\n"
    return text


@pytest.mark.parametrize("note", ["Break detected\n", "Sample slipped 2 mm\n", "Event,paused\n", "broke in a wale\n"])
@pytest.mark.parametrize("at", [2, 40, 79])
@pytest.mark.parametrize("time", [False, True])
def test_a_note_within_a_pull_begins_no_swatch(tmp_path, note, at, time):
    header = ("Time (s)," if time else "") + "Extension (mm),Load (N)\n"
    text = cut(STRETCH[:at], STRETCH[at:], notes=["", note], header=header, time=time)
    fabric = fabric_of(tmp_path, text)
    check(fabric)
    line = at + 2
    assert any(f"line {line}" in remark and "swatch above" in remark for remark in fabric.notes)
    whole = fabric_of(tmp_path, text.replace(note, ""))
    np.testing.assert_array_equal(fabric.stretch[0].runs[0].force, whole.stretch[0].runs[0].force)


@pytest.mark.parametrize("again", ["", "Extension (mm),Load (N)\n"])
def test_cycles_with_titles_are_one_swatch(tmp_path, again):
    up, softer = STRETCH, 0.02 + 0.95 * STRETCH
    text = cut(
        [*up, *up[::-1]], [*up[:5], *softer[5:], *up[::-1]],
        notes=["Specimen 1\nCycle 1\n", "Cycle 2\n" + again],
    )  # fmt: skip
    text = again + text.removeprefix("Extension (mm),Load (N)\n") if again else text
    for cycle, said in (("first", "the first is used"), ("last", "the second is used")):
        settings = LogSettings(swatch_width=0.05, swatch_length=0.1, cycle=cycle)
        fabric = fabric_of(tmp_path, text, settings=settings)
        assert len(fabric.stretch[0].runs) == 1
        assert any(said in note for note in fabric.notes)


@pytest.mark.parametrize(
    "titles", [("Specimen 1", "Specimen 2"), ("A1", "A2"), ("one", "other"), ("Probe A", "Probe B")]
)
def test_specimens_below_titles_alone_are_swatches(tmp_path, titles):
    check(fabric_of(tmp_path, cut(STRETCH, STRETCH, notes=[f"{title}\n" for title in titles])), runs=2)


def test_directions_below_titles_alone_are_swatches(tmp_path):
    both = [*STRETCH, *STRETCH[::-1]]
    fabric = fabric_of(tmp_path, cut(both, both, notes=["weft\n", "warp\n"]), name="log.csv")
    assert [test.direction for test in fabric.stretch] == [Direction.WEFT, Direction.WARP]


def test_a_time_that_goes_on_keeps_a_swatch_together(tmp_path):
    header = "Time (s),Extension (mm),Load (N)\n"
    text = cut(STRETCH, STRETCH, notes=["", "second pull\n"], header=header, time=True)
    check(fabric_of(tmp_path, text))


@pytest.mark.parametrize("results", ["Results\nSpecimen,Max load (N)\n", "\nResults\nMax load of specimen 1\n"])
def test_rows_of_results_are_remarked_on(tmp_path, results):
    text = GOOD + results + "1,12.5\n"
    fabric = fabric_of(tmp_path, text)
    check(fabric)
    row = text.count("\n")
    assert any(f"row {row}," in note and "not read" in note and "Max load" in note for note in fabric.notes)


def test_a_workbook_that_claims_to_be_huge_is_refused_at_once(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active["A1"] = "Load [N]"
    book.active["A1048576"] = 1.0
    book.save(path := tmp_path / "far.xlsx")
    with pytest.raises(InputError):
        read_measurements(path)
    with zipfile.ZipFile(path) as archive:
        texts = {name: archive.read(name) for name in archive.namelist()}
    sheet = "xl/worksheets/sheet1.xml"
    texts[sheet] = texts[sheet].replace(b"A1:A1048576", b"A1:XFD1048576")
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in texts.items():
            archive.writestr(name, text)
    with pytest.raises(InputError):
        read_measurements(path)

"""Measurement files: the form of its own, the tables of tracked pins, and faults told by row and column."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.files.measurements import read_measurements
from yarnscale.swatches.measurements import COMFORT_LOAD, POWER_LOAD, Direction

HEADER = "direction,run,force_N,clamp_distance_mm,mid_width_mm,swatch_width_mm"
ROWS = [
    "weft,1,0.5,105,59,60",
    "weft,1,1.0,109,58,60",
    "weft,1,2.0,115,56,60",
    "weft,2,0.5,106,59,60",
    "weft,2,1.0,110,58,60",
    "weft,2,2.0,116,56,60",
]
METRES = ["weft,2,0.5,0.106,59,60", "weft,2,1.0,0.110,58,60", "weft,2,2.0,0.116,56,60"]
BEND = """direction,run,clamp_distance_cm,loop_ratio,swatch_length_cm,swatch_width_cm
warp,1,0.3,2.5,10,6
warp,1,3.4,1.2,10,6
warp,2,0.3,2.7,10,6
warp,2,3.4,1.2,10,6
"""
FABRIC = """
name = "DKIN8"
stretch = "stretch.csv"
bend = "bend.csv"
area_density = 0.21
pattern = "interlock.chart"
photographs = ["front.png", "back.png"]

[[yarn]]
material = "polyester"
denier = 72
filaments = 75
mass_share = 0.9
stiffness = 3.1
density = 1380

[[yarn]]
material = "spandex"
denier = 20
mass_share = 0.1
coating = "silicone"
"""


def table(folder: Path, rows: list[str], header: str = HEADER) -> Path:
    path = folder / "stretch.csv"
    path.write_text("\n".join(["# measured on Monday", header, *rows]) + "\n")
    return path


def test_a_table_alone_is_a_fabric(tmp_path):
    fabric = read_measurements(table(tmp_path, ROWS))
    (test,) = fabric.stretch
    assert test.direction is Direction.WEFT
    assert test.swatch_width == pytest.approx(0.06)
    assert [run.name for run in test.runs] == ["1", "2"]
    np.testing.assert_allclose(test.runs[0].length, [0.105, 0.109, 0.115])
    np.testing.assert_allclose(test.runs[0].force, [0.5, 1.0, 2.0])


def test_units_are_those_of_the_columns(tmp_path):
    rows = ["weft,1,50,10.5,5.9,6", "weft,1,100,10.9,5.8,6", "weft,1,200,11.5,5.6,6"]
    header = "direction,run,force_cN,clamp_distance_cm,mid_width_cm,swatch_width_cm"
    (test,) = read_measurements(table(tmp_path, rows, header), single_run=True).stretch
    np.testing.assert_allclose(test.runs[0].force, [0.5, 1.0, 2.0])
    np.testing.assert_allclose(test.runs[0].width, [0.059, 0.058, 0.056])


def test_a_fabric_file_holds_everything_of_the_paper(tmp_path):
    table(tmp_path, ROWS)
    (tmp_path / "bend.csv").write_text(BEND)
    (tmp_path / "fabric.toml").write_text(FABRIC)
    fabric = read_measurements(tmp_path / "fabric.toml")
    assert (fabric.name, fabric.area_density, fabric.pattern) == ("DKIN8", 0.21, "interlock.chart")
    assert fabric.photographs == ("front.png", "back.png")
    assert [yarn.material for yarn in fabric.yarns] == ["polyester", "spandex"]
    assert fabric.stiffest_yarn == 3.1
    (bend,) = fabric.bend
    np.testing.assert_allclose(bend.distance, [0.003, 0.034])
    np.testing.assert_allclose(bend.ratio, [2.6, 1.2])


def test_one_run_can_be_accepted_in_the_file(tmp_path):
    table(tmp_path, ROWS[:3])
    (tmp_path / "fabric.toml").write_text('stretch = "stretch.csv"\nsingle_run = true\n')
    assert not read_measurements(tmp_path / "fabric.toml").stretch[0].curve.stretch_spread.any()


def changed(place: int, old: str, new: str) -> list[str]:
    rows = ROWS.copy()
    assert old in rows[place]
    rows[place] = rows[place].replace(old, new)
    return rows


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (changed(1, "109", "-109"), (":4", "clamp_distance_mm", "-109")),
        (changed(1, "109", "0"), (":4", "clamp_distance_mm", "more than zero")),
        (changed(1, "109", "10.9 cm"), (":4", "clamp_distance_mm", "10.9 cm")),
        (changed(1, "109", ""), (":4", "clamp_distance_mm")),
        (changed(1, "109", "nan"), (":4", "clamp_distance_mm")),
        (changed(1, "58", "inf"), (":4", "mid_width_mm")),
        (changed(2, "2.0", "0.7"), (":3", "loading of run '1'", "three readings")),
        (changed(2, "115", "100"), (":5", "clamp_distance_mm", "grows")),
        (changed(1, "weft", "left"), (":4", "direction", "'left'")),
        (changed(1, ",60", ",61"), (":4", "swatch_width_mm", "0.061")),
        (changed(1, ",60", ""), (":4", "6 cells", "found 5")),
        (ROWS[:2] + ROWS[3:], (":3", "three readings or more")),
        ([*ROWS[:3], *METRES], (":6", "clamp_distance_mm", "mixed units")),
        ([*ROWS[:3], *(f"weft,2,{f},{100 + f / 10},59,60" for f in (50, 100, 200))], (":6", "force_N", "mixed units")),
        ([], ("readings", "none")),
    ],
)  # fmt: skip
def test_faults_of_cells_are_told_by_row_and_column(tmp_path, rows, words):
    with pytest.raises(InputError) as caught:
        read_measurements(table(tmp_path, rows))
    assert "stretch.csv" in str(caught.value)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("header", "words"),
    [
        (HEADER.replace("force_N", "force_stone"), ("force_stone", "force_N")),
        (HEADER.replace("force_N", "force"), ("force", "unit", "none")),
        (HEADER.replace("force_N", "pull_N"), ("column force is missing", "pull_N")),
        (HEADER.replace("swatch_width_mm", "swatch_width_cm"), ("mixed units of length",)),
        (HEADER.replace("mid_width_mm", "clamp_distance_cm"), ("mixed units of clamp_distance",)),
        (HEADER.replace("mid_width_mm", "force_N"), ("column 'force_N'", "one column")),
        (HEADER.replace("run", "fabric"), ("column run is missing",)),
    ],
)
def test_faults_of_columns_are_told_by_name(tmp_path, header, words):
    with pytest.raises(InputError) as caught:
        read_measurements(table(tmp_path, ROWS, header))
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("missing", HEADER.split(","))
def test_every_column_but_the_width_at_the_middle_is_needed(tmp_path, missing):
    place = HEADER.split(",").index(missing)
    lines = [[cell for k, cell in enumerate(line.split(",")) if k != place] for line in [HEADER, *ROWS]]
    path = table(tmp_path, [",".join(line) for line in lines[1:]], ",".join(lines[0]))
    if missing == "mid_width_mm":
        assert read_measurements(path).stretch[0].curve.contraction is None
        return
    with pytest.raises(InputError, match="is missing"):
        read_measurements(path)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ('colour = "red"', "colour"),
        ("area_density = -1.0", "area_density"),
        ("area_density = true", "area_density"),
        ("stretch = 3", "stretch"),
        ("stretch = []", "field 'stretch'; expected the name of a file"),
        ("[[yarn]]\nmaterial = 'wool'", "denier"),
        ("[[yarn]]\nmaterial = 'wool'\ndenier = 'thick'", "denier"),
        ("[[yarn]]\nmaterial = 'wool'\ndenier = 70\nmass_share = 0.5", "sum of 1"),
        ("photographs = [1]", "photographs"),
        ("name = ", "TOML"),
    ],
)
def test_faults_of_fabric_files_are_told(tmp_path, change, word):
    table(tmp_path, ROWS)
    lines = {"stretch": 'stretch = "stretch.csv"'} | {change.split(" ")[0]: change}
    (tmp_path / "fabric.toml").write_text("\n".join(lines.values()) + "\n")
    with pytest.raises(InputError) as caught:
        read_measurements(tmp_path / "fabric.toml")
    assert "fabric.toml" in str(caught.value) and word in str(caught.value)


def test_a_missing_table_is_named(tmp_path):
    (tmp_path / "fabric.toml").write_text('stretch = "nowhere.csv"\n')
    with pytest.raises(InputError, match=r"nowhere\.csv"):
        read_measurements(tmp_path / "fabric.toml")


def test_samples_are_chosen_by_the_beginning_of_their_name(tmp_path):
    rows = [f"{name},{row}" for name in ("A1", "A2") for row in ROWS]
    path = table(tmp_path, rows, "fabric," + HEADER)
    assert read_measurements(path, sample="A2").name == "A2"
    for sample in (None, "A", "B"):
        with pytest.raises(InputError, match="A1, A2"):
            read_measurements(path, sample=sample)


def test_tracked_pins_of_four_knits(shared):
    path = shared / "measured" / "acrylic_uniaxial.csv"
    for name in ("Stockinette", "Garter", "Rib", "Seed"):
        fabric = read_measurements(path, sample=f"Acrylic Yarn {name}")
        assert [test.direction for test in fabric.stretch] == [Direction.WEFT, Direction.WARP]
        for test in fabric.stretch:
            assert len(test.runs) == 5
            curve = test.curve.up_to(POWER_LOAD)
            assert curve.load[-1] == pytest.approx(POWER_LOAD)
            assert 0 < curve.stretch_at(COMFORT_LOAD) < curve.stretch[-1]
            assert curve.contraction is not None and (np.diff(curve.contraction) > -0.01).all()
            assert 0.03 < test.swatch_length < 0.1 and 0.03 < test.swatch_width < 0.15
        # One sample's width is known to be that of its clamp; whoever reads it is told.
        assert bool(fabric.notes) == (name == "Garter")


def test_tracked_pins_whose_stress_contradicts_force_and_width_are_refused(tmp_path):
    header = "sample,video,force_N,stress_N_per_mm,axial_length_mm,lateral_length_mm,fabric_width_at_clamp_mm,n_frames"
    rows = [f"Wool X,1,{f},{f / 50},{60 + f},{40 - f},50,9" for f in (1, 2, 3)]
    path = table(tmp_path, rows, header)
    assert read_measurements(path, single_run=True).name == "Wool"
    with pytest.raises(InputError, match="stress_N_per_mm"):
        read_measurements(table(tmp_path, [rows[0].replace("0.02", "20"), *rows[1:]], header), single_run=True)
    with pytest.raises(InputError, match="X or Y"):
        read_measurements(table(tmp_path, [row.replace("Wool X", "Wool") for row in rows], header))


@pytest.mark.parametrize("between", ["then the weft\n", BEND.splitlines()[0] + "\n"])
def test_all_tables_of_a_bend_file_are_read(tmp_path, between):
    (tmp_path / "fabric.toml").write_text(FABRIC)
    table(tmp_path, ROWS)
    weft = "".join(line + "\n" for line in BEND.replace("warp", "weft").splitlines()[1:3])
    (tmp_path / "bend.csv").write_text(BEND + between + weft)
    fabric = read_measurements(tmp_path / "fabric.toml")
    assert [test.direction.value for test in fabric.bend] == ["weft", "warp"]
    np.testing.assert_allclose(fabric.bend[0].ratio, [2.5, 1.2])


def test_specimens_side_by_side_in_a_bend_file_and_unknown_columns(tmp_path):
    (tmp_path / "fabric.toml").write_text(FABRIC)
    table(tmp_path, ROWS)
    lines = [f"{line},{'Humidity' if not k else 65}" for k, line in enumerate(BEND.splitlines()[:3])]
    sides = [f"{line},{line.replace('warp', 'weft')}" for line in lines]
    (tmp_path / "bend.csv").write_text("\n".join(sides) + "\n")
    fabric = read_measurements(tmp_path / "fabric.toml")
    assert [test.direction.value for test in fabric.bend] == ["weft", "warp"]
    assert any("bend.csv" in note and "Humidity" in note for note in fabric.notes)


def test_bend_tables_with_other_sizes_are_refused(tmp_path):
    (tmp_path / "fabric.toml").write_text(FABRIC)
    table(tmp_path, ROWS)
    (tmp_path / "bend.csv").write_text(BEND + BEND.replace("10,6", "12,6"))
    with pytest.raises(InputError, match=r"bend\.csv:7: column 'swatch_length_cm'"):
        read_measurements(tmp_path / "fabric.toml")


BIAXIAL = "Force weft [N];Force warp [N];Strain weft [%];Strain warp [%];Width weft [mm];Width warp [mm]\n"


def test_biaxial_rows_with_forces_or_line_loads(tmp_path):
    table(tmp_path, ROWS)
    (tmp_path / "fabric.toml").write_text('stretch = "stretch.csv"\nbiaxial = "both.csv"\n')
    (tmp_path / "both.csv").write_text(BIAXIAL + "0;0;0;0;50;40\n1,5;0,8;10,5;4;50;40\n2,5;2;20;12;50;40\n")
    found = read_measurements(tmp_path / "fabric.toml").biaxial
    assert found is not None
    np.testing.assert_allclose(found.load, [[0, 0], [30, 20], [50, 50]])
    np.testing.assert_allclose(found.stretch, [[0, 0], [0.105, 0.04], [0.2, 0.12]])
    assert len(found.up_to(45.0, 7).load) == 1 and len(found.up_to(1e9, 7).load) == 2
    lines = "force_weft_N/m,force_warp_N/m,strain_weft [1],strain_warp [1]\n30,20,0.105,0.04\n"
    (tmp_path / "both.csv").write_text(lines)
    np.testing.assert_allclose(read_measurements(tmp_path / "fabric.toml").biaxial.load, [[30, 20]])  # pyright: ignore


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("Width warp [mm]", "Other", (":1", "column width_warp is missing")),
        ("Strain warp [%]", "Strain warp [N]", (":1", "unit", "% or 1", "'N'")),
        ("10,5;4", "10,5;wide", (":2", "Strain warp [%]", "'wide'")),
        ("1,5;0,8", "-1;-1", ("under tension",)),
        ("Force weft", "Temperature", ("both.csv:1", "force_weft is missing")),
    ],
)
def test_faults_of_biaxial_rows_are_told(tmp_path, old, new, words):
    table(tmp_path, ROWS)
    (tmp_path / "fabric.toml").write_text('stretch = "stretch.csv"\nbiaxial = "both.csv"\n')
    (tmp_path / "both.csv").write_text((BIAXIAL + "1,5;0,8;10,5;4;50;40\n").replace(old, new))
    with pytest.raises(InputError) as caught:
        read_measurements(tmp_path / "fabric.toml")
    assert [word for word in words if word not in str(caught.value)] == []

"""Strain, stress and yarn inside a knit: those of the cell that it was made of, wherever its yarns slid."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.material import YarnMaterial

sys.path.append(str(Path(__file__).resolve().parents[2] / "benchmarks"))
from knit_interior import interior

PATTERN = library.build("stockinette")
SOFT = YarnMaterial.preset("hylc2020-stockinette")


def _as_cell(strain: ShellStrain) -> tuple[FabricEnergy, np.ndarray, float]:
    # A cell that holds its yarn back pulls at it where it is sheared, which changes the stress across courses by 5e-5.
    cell = PeriodicCell(PATTERN, SOFT, sliding=True)
    state = cell.relax(strain)
    sheet = YarnSheet.of(PATTERN, 8, 9)
    # Frames go the way of the cell's: first with the macroscopic state, then with the fluctuation.
    affine = cell.placement(replace(state, fluctuation=np.zeros_like(state.fluctuation)))
    sheet = sheet.moved(affine(sheet.source, sheet.tile))
    sheet = sheet.moved(cell.placement(state)(sheet.source, sheet.tile), twist=state.twist[sheet.source])
    return FabricEnergy(sheet, SOFT), state.stress[[0, 2]], state.energy_density


@pytest.mark.parametrize("strain", [ShellStrain(s_x=0.1, s_y=-0.04), ShellStrain(s_x=0.15, s_a=0.03, s_y=-0.08)])
def test_a_sheet_in_a_cells_state_has_its_strain_stress_and_energy(strain: ShellStrain) -> None:
    energy, stress, density = _as_cell(strain)
    found = interior(PATTERN, energy, energy.start(), share=0.5)
    np.testing.assert_allclose(found.strain.vector, strain.vector, atol=1e-9)
    assert found.energy == pytest.approx(density, rel=1e-9)
    assert found.yarn == pytest.approx(1.0, rel=1e-9)
    np.testing.assert_allclose(found.stress, stress, rtol=1e-6)
    # Wherever its tiles are counted from.
    moved = FabricEnergy(replace(energy.sheet, tile=energy.sheet.tile + np.array([7, -20])), SOFT)
    again = interior(PATTERN, moved, moved.start(), share=0.5)
    assert (again.stitches, again.yarn, again.energy) == (found.stitches, found.yarn, found.energy)


def test_yarn_that_slid_along_itself_is_told_from_yarn_that_was_added() -> None:
    energy, _, _ = _as_cell(ShellStrain(s_x=0.05))
    sheet = energy.sheet
    before = interior(PATTERN, energy, energy.start(), share=0.5)
    # Every vertex moves on by 1.4 edges: another vertex at every place, the same fabric.
    place = np.arange(sheet.vertex_count) + 1.4
    place = np.clip(place, 0, np.repeat(sheet.offsets[1:] - 1, np.diff(sheet.offsets)))
    points = np.stack([np.interp(place, np.arange(sheet.vertex_count), x) for x in sheet.vertices.T], 1)
    after = interior(PATTERN, energy, energy.vector(points, sheet.twist), share=0.5)
    np.testing.assert_allclose(after.strain.vector[:3], before.strain.vector[:3], atol=2e-3)
    assert after.yarn == pytest.approx(1.0, abs=2e-3)
    assert abs(after.slid) < 2e-3
    # A sheet that fills the same place with less yarn at rest.
    short = FabricEnergy(replace(sheet, rest_length=0.98 * sheet.rest_length), SOFT)
    assert interior(PATTERN, short, short.start(), share=0.5).yarn == pytest.approx(0.98, rel=1e-6)


def test_heads_that_shorten_from_course_to_course_leave_their_yarn_to_interlacings() -> None:
    """Every course keeps its yarn, but a thousandth more of it lies in the sinkers of every further course."""
    sheet = YarnSheet.of(PATTERN, 8, 9)
    order = np.argsort(PATTERN.vertices[:, 1])
    total = float(PATTERN.rest_length.sum())
    per_row = np.zeros(len(order))
    per_row[order[-4:]], per_row[order[:4]] = 1e-3 * total / 4, -1e-3 * total / 4
    rest = sheet.rest_length - per_row[sheet.source] * (sheet.tile[:, 1] - 4)
    energy = FabricEnergy(replace(sheet, rest_length=rest), SOFT)
    found = interior(PATTERN, energy, energy.start(), share=0.6)
    assert found.slid == pytest.approx(1e-3, rel=1e-3)
    assert found.yarn - found.slid == pytest.approx(1.0, abs=1e-4)


def test_a_bent_sheet_shows_its_curvature() -> None:
    sheet = YarnSheet.of(PATTERN, 10, 12)
    radius = 0.1

    def rolled(reference: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        angle = (reference[:, 0] - 0.04) / radius
        sine, cosine, zero = np.sin(angle), np.cos(angle), np.zeros(len(angle))
        height = radius - reference[:, 2]
        points = np.stack([height * sine, reference[:, 1], radius - height * cosine], 1)
        rows = [[cosine, zero, -sine], [zero, zero + 1.0, zero], [sine, zero, cosine]]
        return points, np.moveaxis(np.array(rows), 2, 0)

    energy = FabricEnergy(sheet.shaped(rolled), SOFT)
    strain = interior(PATTERN, energy, energy.start(), share=0.5).strain
    assert abs(strain.II11 - 1 / radius) < 0.2
    assert abs(strain.II22) < 0.02 and abs(strain.II12) < 0.02
    assert abs(strain.s_y) < 1e-6 and abs(strain.s_x) < 5e-3


def test_other_patterns_and_small_shares_are_refused() -> None:
    energy = FabricEnergy(YarnSheet.of(PATTERN, 4, 4), SOFT)
    with pytest.raises(InputError, match="share"):
        interior(PATTERN, energy, energy.start(), share=0.4)
    plain = library.build("plain")
    energy = FabricEnergy(YarnSheet.of(plain, 4, 4), YarnMaterial.preset("hylc2020-basket"))
    with pytest.raises(InputError, match="one stitch"):
        interior(plain, energy, energy.start())

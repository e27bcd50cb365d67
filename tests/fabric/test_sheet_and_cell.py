"""Fabric yarn by yarn does what its periodic cell says: stretched between grips, and curling at free edges."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.drawing import library
from yarnscale.fabric.boundary import glue
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_friction import FrictionHistory
from yarnscale.fabric.direct_static import rod_equilibrium, safe_path
from yarnscale.fabric.holds import Holds
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.friction import YarnFriction
from yarnscale.yarn.material import YarnMaterial

sys.path.append(str(Path(__file__).resolve().parents[2] / "benchmarks"))
from knit_interior import interior

PATTERN = library.build("stockinette")
SOFT = YarnMaterial.preset("hylc2020-stockinette")
CELL = PeriodicCell(PATTERN, SOFT)


def test_stretched_between_grips_its_inside_is_as_the_cell() -> None:
    """At the strain and with the yarn of its stitches; rows at the free edges are glued, the grips let it narrow."""
    rest = CELL.relax()
    sheet = YarnSheet.of(PATTERN, 8, 11)
    sheet = sheet.moved(CELL.placement(rest)(sheet.source, sheet.tile), twist=rest.twist[sheet.source])
    rows = sheet.radius * np.minimum(sheet.tile[:, 1], 10 - sheet.tile[:, 1])
    springs = glue(sheet, SOFT, distance=rows, width=0.5 * sheet.radius, stiffness=0.05)
    energy = FabricEnergy(sheet, SOFT, springs=springs)
    energy.count_passages()
    state = CELL.relax(ShellStrain(s_x=0.2, s_y=-0.1))
    goal = energy.vector(CELL.placement(state)(sheet.source, sheet.tile), state.twist[sheet.source])
    x = safe_path(energy, energy.start(), goal)
    grips = np.flatnonzero((sheet.tile[:, 0] == 0) | (sheet.tile[:, 0] == 7))
    holds = Holds(grips, energy.positions(x)[grips] * sheet.radius, (True, False, True))
    FrictionHistory.slack(energy).begin(energy, YarnFriction(0.1), x)
    found = rod_equilibrium(energy, x, holds, tolerance=1e-3, max_iterations=60)
    inside = interior(PATTERN, energy, found.x, share=0.5)
    own = PeriodicCell(replace(PATTERN, rest_length=PATTERN.rest_length * inside.yarn), SOFT)
    cell = own.relax(replace(inside.strain, II11=0.0, II12=0.0, II22=0.0))
    assert energy.passage_count == 0
    assert inside.energy == pytest.approx(cell.energy_density, rel=0.05)
    assert inside.stress[0] == pytest.approx(cell.stress[0], rel=0.1)


def test_free_edges_of_stockinette_curl_as_the_moments_of_the_cell_say() -> None:
    """First and last rows to the right side (+z); a little friction keeps the cut yarns from drawing back."""
    rest = CELL.relax()
    assert rest.stress[5] < 0  # a cell that may bend lowers its energy with II22 > 0, ends towards +z
    sheet = YarnSheet.of(PATTERN, 4, 9)
    sheet = sheet.moved(CELL.placement(rest)(sheet.source, sheet.tile), twist=rest.twist[sheet.source])
    energy = FabricEnergy(sheet, SOFT, springs=glue(sheet, SOFT, width=0.003, stiffness=0.02))
    x, middle = energy.start(), np.flatnonzero((sheet.tile == (2, 4)).all(axis=1))[:3]
    history = FrictionHistory.slack(energy)
    for _ in range(2):
        step = history.begin(energy, YarnFriction(0.05), x)
        x = rod_equilibrium(energy, x, Holds(middle, sheet.vertices[middle]), tolerance=1e-3, max_iterations=100).x
        history = step.end(x)
    height = energy.positions(x)[:, 2] - energy.positions(energy.start())[:, 2]
    inner = height[np.isin(sheet.tile[:, 1], (4,))].mean()
    ends = [height[sheet.tile[:, 1] == row].mean() - inner for row in (0, 8)]
    assert min(ends) > 0.4

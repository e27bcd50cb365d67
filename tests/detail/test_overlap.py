"""Distances of yarns on cloth: those of the cell where the cloth is flat, and of layers where it is folded."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.detail.fluctuations import FluctuationTable
from yarnscale.detail.overlap import Overlap
from yarnscale.detail.yarns import YarnDetail
from yarnscale.kinematics import ShellStrain
from yarnscale.shell.mesh import rectangle


def test_flat_cloth_has_the_gap_of_the_cell(cell: PeriodicCell, table: FluctuationTable) -> None:
    mesh = rectangle(0.05, 0.04, 0.008, irregularity=0.2)
    detail = YarnDetail.of(table, mesh)
    stretched = np.column_stack([mesh.material * [1.2, 1.1], np.zeros(mesh.vertex_count)])
    overlap = Overlap.of(detail, detail.curves(stretched))
    state = cell.relax(ShellStrain(0.2, 0.0, 0.1))
    assert overlap.fabric.min() == pytest.approx(state.min_distance_over_diameter, rel=1e-3)
    assert np.isinf(overlap.layers).all()


def test_layers_that_lie_in_each_other_are_told_apart(table: FluctuationTable) -> None:
    mesh = rectangle(0.08, 0.02, 0.005)
    detail = YarnDetail.of(table, mesh)
    x, y = mesh.material.T
    angle = 2 * np.pi * x / 0.05
    rolled = np.column_stack([0.008 * np.cos(angle), y, 0.008 * np.sin(angle)])
    overlap = Overlap.of(detail, detail.curves(rolled))
    assert overlap.layers.min() < 0.5 and np.isfinite(overlap.fabric).mean() > 0.5

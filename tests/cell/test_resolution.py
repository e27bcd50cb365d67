"""Results do not depend on how finely yarns are cut."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.drawing import library
from yarnscale.drawing.curves import PeriodicCurve, pattern_from_curves
from yarnscale.kinematics import ShellStrain
from yarnscale.swatches.yarn_model import estimated_radius
from yarnscale.yarn.material import ContactRule, YarnMaterial
from yarnscale.yarn.pattern import YarnPattern

YARN = YarnMaterial.preset("hylc2020-stockinette")
COUNTS = (27, 40, 54, 80)


@pytest.fixture(scope="module")
def cut() -> dict[int, YarnPattern]:
    return {count: library.build("stockinette", vertices_per_stitch=count) for count in COUNTS}


def test_length_and_radius(cut: dict[int, YarnPattern]) -> None:
    lengths = np.array([pattern.rest_length.sum() for pattern in cut.values()])
    radii = np.array([estimated_radius(pattern) for pattern in cut.values()])
    assert np.ptp(lengths) < 4e-4 * lengths.mean() and np.ptp(radii) < 0.05 * radii.mean()


def test_tension(cut: dict[int, YarnPattern]) -> None:
    """Taut fabric within 1 %; at the onset of tension, where 0.1 % of length counts as 15 %, within 5 % from 40 on."""
    cells = [PeriodicCell(pattern, YARN) for pattern in cut.values()]
    for strain, bound, first in (
        (ShellStrain(s_x=0.3), 0.01, 0),
        (ShellStrain(s_x=0.215, s_y=-0.123), 0.05, 1),
    ):
        states = [cell.relax(strain) for cell in cells[first:]]
        tension = np.array([state.stress[0] for state in states])
        assert all(state.converged for state in states)
        assert np.ptp(tension) < bound * tension[-1]


def arc(turn: float, count: int) -> YarnPattern:
    """A yarn that bends by an angle and back in turns of the radius of contact, 1 mm, in edges of any number."""
    half = np.linspace(0.0, 1.0, 400, endpoint=False)
    angle = turn * np.concatenate([0.5 - half, half - 0.5])
    step = turn / 400 * np.stack([np.cos(angle), np.sin(angle), np.zeros(800)], 1)
    line = np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)[:-1]]) * 1e-3
    period = np.array([1e-3 * step[:, 0].sum(), 0.05])
    curve = PeriodicCurve(line, (1, 0)).vertices(count, period)
    return pattern_from_curves([curve], period, 1e-3)


@pytest.mark.parametrize("count", [16, 40, 120])
def test_a_bent_yarn_does_not_touch_itself_where_it_is_cut_finely(count: int) -> None:
    """Published convention: as soon as four edges are shorter than the diameter."""
    pattern = arc(2.0, count)
    for kernel in ("hylc2020", "est2022"):
        rule = ContactRule(kernel, outer_radius_ratio=0.99)
        smooth = PeriodicCell(pattern, replace(YARN, contact=rule)).energy(ShellStrain())
        assert smooth.parts(smooth.start())["contact"] == 0.0
    polyline = PeriodicCell(replace(pattern, polyline=True), YARN).energy(ShellStrain())
    assert polyline.parts(polyline.start())["contact"] > 0.0


def test_a_fold_of_yarn_touches_itself() -> None:
    """Two legs 1.8 radii apart: with an outer radius of contact up to 1.5 they press, however finely cut."""
    side, turn = np.linspace(0.0, 6.0, 61), np.linspace(0.0, np.pi, 61)[1:-1]
    up, down = np.stack([0 * side - 0.9, side], 1), np.stack([0 * side + 0.9, 6.0 - side], 1)
    top = np.stack([-0.9 * np.cos(turn), 6.0 + 0.9 * np.sin(turn)], 1)
    foot = np.stack([1.8 - 0.9 * np.cos(turn), -0.9 * np.sin(turn)], 1)
    plane = np.concatenate([up, top, down, foot])
    line = 1e-3 * np.column_stack([plane, np.zeros(len(plane))])
    for ratio in (1.0, 1.5):
        rule = ContactRule("est2022", outer_radius_ratio=ratio)
        energies = []
        for count in (40, 120):
            curve = PeriodicCurve(line, (1, 0)).vertices(count, np.array([3.6e-3, 0.05]))
            pattern = pattern_from_curves([curve], (3.6e-3, 0.05), 1e-3)
            energy = PeriodicCell(pattern, replace(YARN, contact=rule)).energy(ShellStrain())
            energies.append(energy.parts(energy.start())["contact"])
        assert energies[0] > 0.0 and energies[1] == pytest.approx(energies[0], rel=0.1)

"""Yarns that pass through each other are noticed; those that only move are not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell, periodic
from yarnscale.cell.energy import CellEnergy
from yarnscale.cell.topology import _lasting, crossed, crossings, jump_is_safe
from yarnscale.homogenize.worker import CODE_OF, record
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn import library
from yarnscale.yarn.material import YarnMaterial
from yarnscale.yarn.segment_cuts import pair_cuts

MATERIAL = YarnMaterial.preset("hylc2020-stockinette")
Move = Callable[[np.ndarray], np.ndarray]


def _moved(energy: CellEnergy, yarn: int, move: Move) -> np.ndarray:
    """A free vector in which the vertices (k, 3) [r] of one yarn at rest are moved."""
    pattern = energy.pattern
    fluctuation = np.zeros((energy.count, 3))
    chain = pattern.yarns[yarn]
    fluctuation[chain] = move(pattern.vertices[chain] / pattern.radius)
    return np.concatenate([fluctuation.ravel(), pattern.twist])


@pytest.fixture(scope="module", params=["basket-2x2", "stockinette"])
def energy(request: pytest.FixtureRequest) -> CellEnergy:
    pattern = library.build(request.param)
    if len(pattern.yarns) == 1:
        pattern = pattern.repeated(1, 2)  # lifted alone, the only yarn would take its copies along
    return PeriodicCell(pattern, MATERIAL).energy(ShellStrain())


def test_time_place_and_side_of_a_cut() -> None:
    """A segment along y at height 1 falls to height −3 through one along x, at a quarter of the way."""
    before = np.array([[0.0, 0, 0], [1, 0, 0], [0.25, -0.5, 1], [0.25, 0.5, 1]])
    ends, fall = np.array([1, 0, 3, 2]), np.array([[0.0], [0], [1], [1]]) * (0, 0, -4.0)
    (cut,) = pair_cuts(before, before + fall, ends, np.array([0]), np.array([2]))
    np.testing.assert_allclose(cut[:5], [0, 2, 0.25, 0.25, 0.5], atol=1e-12)
    (back,) = pair_cuts(before + fall, before, ends, np.array([0]), np.array([2]))
    assert back[5] == -cut[5]
    assert len(pair_cuts(before, before + fall / 8, ends, np.array([0]), np.array([2]))) == 0
    aside = before + np.array([[0.0], [0], [1], [1]]) * (1.0, 0, 0)
    assert len(pair_cuts(aside, aside + fall, ends, np.array([0]), np.array([2]))) == 0


def test_two_opposite_cuts_of_one_motion_undo_each_other() -> None:
    """Forth and back at the same place counts for nothing, at distant places of the yarn it does."""
    energy = PeriodicCell(library.build("basket-2x2"), MATERIAL).energy(ShellStrain())
    one = np.array([[0.0, energy.pattern.yarns[1][0], 0.5, 0.2, 0.5, 1.0]])
    far = one.copy()
    far[0, 5] = -1.0
    assert len(_lasting(energy, np.concatenate([one, far]))) == 0
    assert len(_lasting(energy, np.concatenate([one, one]))) == 2
    far[0, 0] += len(energy.pattern.yarns[0]) // 2
    assert len(_lasting(energy, np.concatenate([one, far]))) == 2


def _lifted(points: np.ndarray) -> np.ndarray:
    """Off the plane, above all others."""
    return np.column_stack([0 * points[:, :2], np.full(len(points), 12.0)])


def test_a_yarn_lifted_out_of_the_cloth_has_crossed(energy: CellEnergy) -> None:
    assert crossed(energy, _moved(energy, 0, _lifted))


def test_rest_and_small_moves_have_not(energy: CellEnergy) -> None:
    assert not crossed(energy, energy.start())
    noise = 0.15 * np.random.default_rng(0).standard_normal(3 * energy.count)
    assert not crossed(energy, np.concatenate([noise, energy.pattern.twist]))


def test_a_weave_with_one_crossing_swapped_has_crossed() -> None:
    """One over turned into one under: a single cut, the smallest change there is."""
    energy = PeriodicCell(library.build("basket-2x2"), MATERIAL).energy(ShellStrain())
    heights = energy.pattern.vertices[energy.pattern.yarns[0], 2] / energy.pattern.radius
    top = int(np.argmax(heights))

    def pressed(points: np.ndarray) -> np.ndarray:
        along = np.abs(np.arange(len(points)) - top)
        along = np.minimum(along, len(points) - along)
        push = np.zeros_like(points)
        push[:, 2] = -6.0 * np.exp(-((along / 1.5) ** 2))
        return push

    x = _moved(energy, 0, pressed)
    found = crossings(energy, energy.nodes.offset, energy.nodes.expand(x)[: -energy.count].reshape(-1, 3))
    assert 1 <= len(found) <= 2
    assert len(set(found[:, 5])) == 1


def test_a_cut_that_is_taken_back_does_not_count() -> None:
    """A yarn that goes through another and comes back, along a way of two straight motions, has not crossed it."""
    energy = PeriodicCell(library.build("basket-2x2"), MATERIAL).energy(ShellStrain())
    rest = energy.nodes.offset
    away = energy.nodes.expand(_moved(energy, 0, _lifted))[: -energy.count].reshape(-1, 3)
    out, back = crossings(energy, rest, away), crossings(energy, away, rest)
    assert len(out) == len(back) > 0
    np.testing.assert_array_equal(np.sort(out[:, 5]), np.sort(-back[:, 5]))


def test_large_strains_do_not_cross() -> None:
    cell = PeriodicCell(library.build("stockinette"), MATERIAL)
    for strain in (ShellStrain(0.6, -0.5, 0.6), ShellStrain(-0.15, 0.3, -0.1), ShellStrain(II11=100.0)):
        state = cell.relax(strain)
        assert state.converged and not state.crossed and state.outcome == "converged"


def test_an_unsafe_jump_is_noticed_and_goes_by_way_of_nearer_states() -> None:
    cell = PeriodicCell(library.build("stockinette"), MATERIAL)
    far = ShellStrain(0.8, 0.6, 0.8)
    start = cell.relax(ShellStrain(0.8, -0.6, 0.8))
    energy = cell.energy(far)
    x = energy.start(start.fluctuation / cell.pattern.radius, start.twist)
    assert jump_is_safe(cell.energy(start.strain), x, start.strain)
    state, direct = cell.relax(far, start=start), cell.relax(far)
    assert state.converged and not state.crossed
    assert state.energy_density == pytest.approx(direct.energy_density, rel=0.01)


def test_a_seed_that_crossed_is_dropped() -> None:
    """A seed with a yarn in the wrong place relaxes to another fabric; the way from rest is taken instead."""
    cell = PeriodicCell(library.build("basket-2x2"), YarnMaterial.preset("hylc2020-basket"))
    rest = cell.relax()
    wrong = _moved(cell.energy(ShellStrain()), 0, _lifted)
    fluctuation = wrong[: 3 * len(rest.twist)].reshape(-1, 3) * cell.pattern.radius
    state = cell.relax(ShellStrain(), start=replace(rest, fluctuation=fluctuation))
    assert state.converged and not state.crossed
    assert state.energy_density == pytest.approx(rest.energy_density, rel=1e-6)


def test_a_crossed_state_is_recorded_as_such() -> None:
    cell = PeriodicCell(library.build("basket-2x2"), MATERIAL)
    state = replace(cell.relax(), crossed=True)
    assert state.outcome == "crossed"
    assert record(state)["status"] == CODE_OF["crossed"]


@pytest.mark.parametrize("cut", [False, True])
def test_a_state_that_seems_crossed_is_followed_from_rest(cut: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a way without a cut leads to is not crossed, whatever the straight motion from rest says."""
    cell, strain = PeriodicCell(library.build("plain"), MATERIAL), ShellStrain(0.3, 0.2, 0.1)
    expected = cell.relax(strain)
    monkeypatch.setattr(periodic, "crossed", lambda energy, _: bool(energy.strain.vector.any()))
    if cut:
        monkeypatch.setattr(periodic, "safe_move", lambda energy, *_: energy.strain.s_x < 0.2)
    state = cell.relax(strain)
    assert state.converged
    assert state.crossed == cut
    assert state.energy_density == pytest.approx(expected.energy_density, rel=1e-6)

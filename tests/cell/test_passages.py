"""Yarns that pass through each other are noticed; those that only move are not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell, continuation
from yarnscale.cell.energy import CellEnergy
from yarnscale.cell.passages import (
    has_passages,
    jump_is_safe,
    linked_differently,
    passages_between,
    passages_from_drawing,
    safe_move,
)
from yarnscale.drawing import library
from yarnscale.homogenize.worker import CODE_OF, record
from yarnscale.kinematics import ShellStrain
from yarnscale.numerics.linear_solver import linear_solver
from yarnscale.numerics.newton import NewtonOptions, minimise
from yarnscale.yarn.material import YarnMaterial
from yarnscale.yarn.passages import Passages, _remainder, pair_passages

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
    (cut,) = pair_passages(before, before + fall, ends, np.array([0]), np.array([2]))
    np.testing.assert_allclose(cut[:5], [0, 2, 0.25, 0.25, 0.5], atol=1e-12)
    (back,) = pair_passages(before + fall, before, ends, np.array([0]), np.array([2]))
    assert back[5] == -cut[5]
    assert len(pair_passages(before, before + fall / 8, ends, np.array([0]), np.array([2]))) == 0
    aside = before + np.array([[0.0], [0], [1], [1]]) * (1.0, 0, 0)
    assert len(pair_passages(aside, aside + fall, ends, np.array([0]), np.array([2]))) == 0


def test_segments_side_by_side_do_not_cut_however_round_off_tilts_them() -> None:
    """Parallel floats of a weave are coplanar but for round-off, whose sign any motion changes."""
    generator, first = np.random.default_rng(0), 4 * np.arange(3000)
    along = generator.uniform(0.5, 1.0, (3000, 1, 3))
    places = generator.uniform(50.0, 100.0, (3000, 1, 3)) + along * np.array([[0.0], [1.0], [0.1], [1.1]])
    places[:, 2:] += np.cross(along, generator.uniform(2.0, 3.0, (3000, 1, 3)))
    lifted = places + generator.uniform(-0.1, 0.1, places.shape) * [[1.0], [1.0], [0.0], [0.0]]
    ends = np.where(np.arange(12000) % 2 == 0, np.arange(12000) + 1, -1)
    assert len(pair_passages(places.reshape(-1, 3), lifted.reshape(-1, 3), ends, first, first + 2)) == 0


def test_two_opposite_cuts_of_one_motion_undo_each_other() -> None:
    """Forth and back at the same place counts for nothing, at distant places of the yarn it does."""
    energy = PeriodicCell(library.build("basket-2x2"), MATERIAL).energy(ShellStrain())

    def lasting(*rows: np.ndarray) -> int:
        return len(Passages(energy.strands, energy.stiffness, np.concatenate(rows)).lasting().rows)

    one = np.array([[0.0, energy.pattern.yarns[1][0], 0.5, 0.2, 0.5, 1.0]])
    far = one.copy()
    far[0, 5] = -1.0
    assert lasting(one, far) == 0 and lasting(one, one) == 2
    far[0, 0] += len(energy.pattern.yarns[0]) // 2
    assert lasting(one, far) == 2


def _lifted(points: np.ndarray) -> np.ndarray:
    """Off the plane, above all others."""
    return np.column_stack([0 * points[:, :2], np.full(len(points), 12.0)])


def test_a_yarn_lifted_out_of_the_cloth_has_crossed(energy: CellEnergy) -> None:
    assert has_passages(energy, _moved(energy, 0, _lifted))


def test_rest_and_small_moves_have_not(energy: CellEnergy) -> None:
    assert not has_passages(energy, energy.start())
    noise = 0.15 * np.random.default_rng(0).standard_normal(3 * energy.count)
    assert not has_passages(energy, np.concatenate([noise, energy.pattern.twist]))


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
    found = passages_from_drawing(energy, x).lasting().rows
    assert 1 <= len(found) <= 2
    assert len(set(found[:, 5])) == 1


def test_a_cut_that_is_taken_back_does_not_count() -> None:
    """A yarn that goes through another and comes back, along a way of two straight motions, has not crossed it."""
    energy = PeriodicCell(library.build("basket-2x2"), MATERIAL).energy(ShellStrain())
    flat, away = ShellStrain(), _moved(energy, 0, _lifted)[: 3 * energy.count].reshape(-1, 3)
    shapes = (flat, np.zeros_like(away)), (flat, away)
    out, back = (passages_between(energy, *way).lasting().rows for way in (shapes, shapes[::-1]))
    assert len(out) == len(back) > 0
    np.testing.assert_array_equal(np.sort(out[:, 5]), np.sort(-back[:, 5]))


def test_large_strains_do_not_cross() -> None:
    cell = PeriodicCell(library.build("stockinette"), MATERIAL)
    for strain in (ShellStrain(0.6, -0.5, 0.6), ShellStrain(-0.15, 0.3, -0.1), ShellStrain(II11=100.0)):
        state = cell.relax(strain)
        assert state.converged and not state.passages and state.outcome == "converged"


def test_an_unsafe_jump_is_noticed_and_goes_by_way_of_nearer_states() -> None:
    cell = PeriodicCell(library.build("stockinette"), MATERIAL)
    far = ShellStrain(0.8, 0.6, 0.8)
    start = cell.relax(ShellStrain(0.8, -0.6, 0.8))
    energy = cell.energy(far)
    x = energy.start(start.fluctuation / cell.pattern.radius, start.twist)
    assert jump_is_safe(cell.energy(start.strain), x, start.strain)
    state, direct = cell.relax(far, start=start), cell.relax(far)
    assert state.converged and not state.passages
    assert state.energy_density == pytest.approx(direct.energy_density, rel=0.01)


def test_a_seed_that_crossed_is_dropped() -> None:
    """A seed with a yarn in the wrong place relaxes to another fabric; the way from rest is taken instead."""
    cell = PeriodicCell(library.build("basket-2x2"), YarnMaterial.preset("hylc2020-basket"))
    rest = cell.relax()
    wrong = _moved(cell.energy(ShellStrain()), 0, _lifted)
    fluctuation = wrong[: 3 * len(rest.twist)].reshape(-1, 3) * cell.pattern.radius
    state = cell.relax(ShellStrain(), start=replace(rest, fluctuation=fluctuation))
    assert state.converged and not state.passages
    assert state.energy_density == pytest.approx(rest.energy_density, rel=1e-6)


def test_a_crossed_state_is_recorded_as_such() -> None:
    cell = PeriodicCell(library.build("basket-2x2"), MATERIAL)
    state = replace(cell.relax(), passages=True)
    assert state.outcome == "passages"
    assert record(state)["status"] == CODE_OF["passages"]


def test_links_change_where_a_weft_is_lifted_and_not_where_a_course_is() -> None:
    """Warp and weft are linked, over and under; a course of loops can be pulled out of those beside it."""
    weave = PeriodicCell(library.build("basket-2x2"), MATERIAL).energy(ShellStrain())
    knit = PeriodicCell(library.build("stockinette").repeated(1, 2), MATERIAL).energy(ShellStrain())
    for energy, linked in ((weave, True), (knit, False)):
        x = _moved(energy, 0, _lifted)
        assert has_passages(energy, x)
        assert linked_differently(energy, x) == linked
        assert not linked_differently(energy, energy.start())


@pytest.mark.parametrize("first", [(1, 0), (0, 2), (0, 0)])
@pytest.mark.parametrize("second", [(0, 1), (2, 1), (0, 3), (0, 0), (-1, 2)])
def test_tiles_that_differ_by_shifts_are_the_same(first: tuple[int, int], second: tuple[int, int]) -> None:
    one, two = np.array(first), np.array(second)
    tile = np.array([3, -5])
    for a, b in ((1, 0), (0, 1), (-2, 3)):
        assert _remainder(tile + a * one + b * two, one, two) == _remainder(tile, one, two)
    if not one.any():
        assert len({_remainder(tile + np.array((k, 0)), one, np.zeros(2, int)) for k in range(4)}) == 4


def test_a_yarn_moved_by_more_than_the_cell_is_seen_to_cross() -> None:
    """A warp that jumps over the next warps ends where a copy was: wefts are cut on the way down, tiles away."""
    energy = PeriodicCell(library.build("plain"), MATERIAL).energy(ShellStrain())
    period = energy.pattern.period / energy.pattern.radius
    number = next(k for k, shift in enumerate(energy.pattern.yarn_shift) if shift[1])
    chain = energy.pattern.yarns[number]
    fluctuation = np.zeros((energy.count, 3))
    fluctuation[chain, 0], fluctuation[chain, 2] = 3.5 * period[0], 0.2
    assert has_passages(energy, np.concatenate([fluctuation.ravel(), energy.pattern.twist]))


def test_a_course_lifted_out_of_its_loops_is_no_start() -> None:
    """Linking numbers do not see it; no motion from the drawing leads to it."""
    cell = PeriodicCell(library.build("stockinette").repeated(1, 2), MATERIAL)
    rest = cell.relax()
    wrong = _moved(cell.energy(ShellStrain()), 0, _lifted)
    fluctuation = wrong[: 3 * len(rest.twist)].reshape(-1, 3) * cell.pattern.radius
    state = cell.relax(ShellStrain(s_x=0.1), start=replace(rest, fluctuation=fluctuation))
    assert state.usable
    assert state.energy_density == pytest.approx(cell.relax(ShellStrain(s_x=0.1)).energy_density, rel=1e-6)


def test_a_start_known_to_be_crossed_is_left_aside() -> None:
    cell = PeriodicCell(library.build("plain"), MATERIAL)
    rest = cell.relax()
    state = cell.relax(start=replace(rest, fluctuation=np.full_like(rest.fluctuation, np.nan), passages=True))
    assert state.usable
    assert state.energy_density == pytest.approx(rest.energy_density, rel=1e-6)


def test_a_state_that_a_straight_motion_takes_for_crossed_is_good(monkeypatch: pytest.MonkeyPatch) -> None:
    """Loops may swing around each other on their way; no step of the solver cuts, and its equilibrium is kept."""
    pattern = library.build("stockinette")
    monkeypatch.setattr(continuation, "has_passages", lambda *_: True)  # as where the straight motion is of no use
    cell = PeriodicCell(pattern, MATERIAL)
    rest = cell.relax()
    state = cell.relax(ShellStrain(s_x=0.2), start=rest)
    assert rest.usable and state.usable
    monkeypatch.undo()
    assert state.energy_density == pytest.approx(cell.relax(ShellStrain(s_x=0.2), start=rest).energy_density, rel=1e-6)


def test_no_step_of_a_solve_takes_yarns_through_each_other() -> None:
    """Every step of the way, looked at by itself: the step bound is what keeps the fabric as it was drawn."""
    energy = PeriodicCell(library.build("single-jersey"), MATERIAL).energy(ShellStrain(-0.25, 0.3, -0.2))
    points = [energy.start()]
    minimise(
        energy,
        points[0],
        NewtonOptions(max_iterations=80),
        bound=energy.bound,
        after_step=lambda x: points.append(x.copy()),
        linear=linear_solver(energy.constraints),
    )
    moved = points[-1][: 3 * energy.count].reshape(-1, 3)
    assert len(points) > 10 and np.linalg.norm(moved, axis=1).max() > 1.0
    for before, after in pairwise(points):
        assert safe_move(energy, before, after)

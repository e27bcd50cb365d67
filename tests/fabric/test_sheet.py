"""Finite sheets: whole loops, the energy of the periodic cell inside, frames that turn with the shape."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.fabric.boundary import CROSSING, LOOPED, border_distance, glue
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.close_pairs import close_pairs, nearest_places
from yarnscale.yarn.frames import signed_angle, unit_edges
from yarnscale.yarn.material import YarnMaterial

STOCKINETTE = library.build("stockinette")
SOFT = YarnMaterial.preset("hylc2020-stockinette")


@pytest.mark.parametrize("name", ["stockinette", "plain", "honeycomb", "satin-5"])
def test_a_sheet_has_all_yarns_of_its_periods(name: str) -> None:
    pattern = library.build(name)
    sheet = YarnSheet.of(pattern, 3, 4)
    along_x = int((pattern.yarn_shift[:, 0] != 0).sum())
    assert len(sheet.closed) == 4 * along_x + 3 * (len(pattern.yarns) - along_x)
    assert abs(sheet.vertex_count - 12 * len(pattern.edges)) <= len(sheet.closed)
    # Consecutive vertices of the sheet are neighbours in the pattern, as far apart as there.
    edges = sheet.edges
    assert (pattern.next_vertex[sheet.source[edges]] == sheet.source[sheet.following[edges]]).all()
    vectors = sheet.vertices[sheet.following[edges]] - sheet.vertices[edges]
    np.testing.assert_allclose(vectors, pattern.edge_vectors()[sheet.source[edges]], atol=1e-15)


@pytest.mark.parametrize("name", ["stockinette", "plain"])
def test_inside_a_sheet_the_energy_is_that_of_the_periodic_cell(name: str) -> None:
    pattern = library.build(name)
    material = YarnMaterial.preset(library.structure(name).material)
    cell = PeriodicCell(pattern, material)
    state = cell.relax(ShellStrain(s_x=0.1, s_a=0.05, s_y=-0.04))
    sheet = YarnSheet.of(pattern, 7, 7)
    # Frames go the way of the cell's: first with the macroscopic state, then with the fluctuation.
    affine = cell.placement(replace(state, fluctuation=np.zeros_like(state.fluctuation)))
    sheet = sheet.moved(affine(sheet.source, sheet.tile))
    sheet = sheet.moved(cell.placement(state)(sheet.source, sheet.tile), twist=state.twist[sheet.source])
    energy = FabricEnergy(sheet, material)
    shares = energy.vertex_shares(energy.start())[0]
    inside = ((sheet.tile >= 3) & (sheet.tile < 5)).all(axis=1)
    assert inside.sum() == 4 * len(pattern.edges)
    assert shares[inside].sum() / (4 * pattern.area) == pytest.approx(state.energy_density, rel=1e-10)
    assert shares.sum() == pytest.approx(energy.value(energy.start()) * energy.unit, rel=1e-12)


def test_a_tube_closes_and_all_its_stitches_are_alike() -> None:
    sheet = YarnSheet.of(STOCKINETTE, 40, 4, tube=True)
    assert sheet.closed.all() and len(sheet.closed) == 4
    assert sheet.vertex_count == 160 * len(STOCKINETTE.edges)
    energy = FabricEnergy(sheet, SOFT)
    shares = energy.vertex_shares(energy.start())[0]
    for vertex in (0, 5, 13):
        each = shares[sheet.source == vertex].reshape(4, 40)
        np.testing.assert_allclose(each, np.repeat(each[:, :1], 40, axis=1), rtol=1e-9)


def test_energy_does_not_know_rigid_motion_nor_how_often_the_fabric_turned() -> None:
    """Frames turn about the tangents on a curved way; the material does not, so that twists take it back."""
    sheet = YarnSheet.of(STOCKINETTE, 4, 4)
    energy = FabricEnergy(sheet, SOFT)
    value = energy.value(energy.start())
    cross = np.cross(np.eye(3), np.array([0.48, 0.6, 0.64]))
    turn = np.eye(3) + np.sin(1.1) * cross + (1 - np.cos(1.1)) * cross @ cross
    x, director, turned = energy.start(), sheet.reference_director, np.zeros(energy.count)
    for _ in range(7):  # 7.7 rad: more than a full turn
        positions = energy.positions(x) @ turn.T
        director = director @ turn.T
        energy.anchor(energy.vector(positions * sheet.radius, sheet.twist))
        tangents = unit_edges(positions, sheet.following)
        back = signed_angle(energy.frames.director, director, tangents)
        turned = back + 2 * np.pi * np.round((turned - back) / (2 * np.pi))
        x = energy.vector(positions * sheet.radius, sheet.twist + turned)
        assert energy.value(x) == pytest.approx(value, rel=1e-9)


def test_anchoring_changes_no_energy_and_no_gradient() -> None:
    generator = np.random.default_rng(3)
    energy = FabricEnergy(YarnSheet.of(STOCKINETTE, 4, 4), SOFT)
    x = energy.start()
    x = x + 0.05 * generator.standard_normal(len(x))
    value, forces = energy.gradient(x)
    energy.anchor(x)
    anchored, others = energy.gradient(x)
    gradient, other = forces.sum(axis=0), others.sum(axis=0)
    assert anchored == pytest.approx(value, rel=1e-12)
    # Twists count from the anchors: forces on positions agree there, where the frames have not turned.
    np.testing.assert_allclose(other[3 * energy.count :], gradient[3 * energy.count :], atol=1e-9)


def test_hessian_is_the_slope_of_the_gradient() -> None:
    generator = np.random.default_rng(4)
    sheet = YarnSheet.of(STOCKINETTE, 3, 3)
    energy = FabricEnergy(sheet, SOFT, springs=glue(sheet, SOFT))
    x = energy.start() + 0.02 * generator.standard_normal(4 * energy.count)
    direction = generator.standard_normal(len(x))
    _, _, block, entries = energy.hessian(x)
    step = 1e-6
    ahead, behind = (energy.gradient(x + s * direction)[1].sum(axis=0) for s in (step, -step))
    slope = (ahead - behind) / (2 * step)
    product = block.pattern.multiply(entries, direction)
    assert np.abs(slope).max() > 1e-3
    np.testing.assert_allclose(product, slope, rtol=1e-5, atol=1e-6 * np.abs(slope).max())


def test_close_pairs_are_those_of_a_plain_search() -> None:
    sheet = YarnSheet.of(STOCKINETTE, 3, 2)
    positions, following = sheet.vertices / sheet.radius, sheet.following
    first, second = close_pairs(sheet.strands, positions, 2.5, neighbours=3)
    found = set(zip(first.tolist(), second.tolist(), strict=True))
    yarn, expected = sheet.yarn_of_vertex, set()
    for i in sheet.edges:
        for g in sheet.edges[sheet.edges > i]:
            if yarn[i] == yarn[g] and g - i <= 3:
                continue
            ends = (positions[i], positions[following[i]], positions[g], positions[following[g]])
            if nearest_places(np.array(ends), 0, 1, 2, 3)[2] < 2.5**2:
                expected.add((int(i), int(g)))
    assert found == expected and len(found) > 400


def test_glue_pulls_through_the_thickness_only() -> None:
    sheet = YarnSheet.of(STOCKINETTE, 6, 8)
    springs = glue(sheet, SOFT, width=6.0 * sheet.radius, pull=0.5)
    away = sheet.vertices[springs.pairs[:, 0]] - sheet.vertices[springs.pairs[:, 1]]
    length = np.linalg.norm(away, axis=1)
    assert (springs.rest_length <= length + 1e-15).all() and (springs.rest_length < 0.99 * length).any()
    border = border_distance(sheet) < 6.0 * sheet.radius
    assert len(springs) > 100
    near = springs.pairs.ravel()
    touching = border | border[np.maximum(sheet.strands.before, 0)] | border[np.maximum(sheet.following, 0)]
    assert touching[near].all()


@pytest.mark.parametrize("name", library.names())
def test_glue_is_firmer_where_yarns_cross_than_where_they_are_looped(name: str) -> None:
    """Knits are of looped yarns, weaves of crossing ones: the sheet tells, not its name."""
    sheet = YarnSheet.of(library.build(name), 3, 3)
    springs = glue(sheet, SOFT)
    unit = SOFT.stretch_stiffness(sheet.radius) / sheet.radius
    expected = LOOPED if library.structure(name).draft is None else CROSSING
    assert len(springs)
    np.testing.assert_allclose(springs.stiffness / unit, expected, rtol=1e-12)


def test_a_woven_tube_is_of_crossing_yarns_wherever_its_rings_begin() -> None:
    tube = YarnSheet.of(library.build("plain"), 12, 3, tube=True)
    place = tube.vertices[:, 1]
    springs = glue(tube, SOFT, distance=np.minimum(place - place.min(), place.max() - place))
    unit = SOFT.stretch_stiffness(tube.radius) / tube.radius
    np.testing.assert_allclose(springs.stiffness / unit, CROSSING, rtol=1e-12)


def test_a_yarn_laid_across_loops_is_told_by_itself() -> None:
    """Straight over the wales of stockinette, it meets each course once."""
    loops = YarnSheet.of(STOCKINETTE, 4, 4)
    low, high = loops.vertices.min(axis=0), loops.vertices.max(axis=0)
    line = np.linspace([low[0] + 1e-3, low[1], high[2] + 1.5e-3], [low[0] + 1e-3, high[1], high[2] + 1.5e-3], 12)
    both = loops.joined(YarnSheet.from_lines([line], loops.radius))
    springs = glue(both, SOFT, width=0.01)
    laid = (springs.pairs >= loops.vertex_count).any(axis=1)
    unit = SOFT.stretch_stiffness(both.radius) / both.radius
    assert laid.any() and not laid.all()
    np.testing.assert_allclose(springs.stiffness / unit, np.where(laid, CROSSING, LOOPED), rtol=1e-12)


@pytest.mark.parametrize("name", ["stockinette", "satin-5"])
def test_glue_bears_the_weight_of_the_border_and_not_the_pull(name: str) -> None:
    """Knit and weave: a fabric pulled by a tenth has its own force, and its outermost yarns weigh next to nothing."""
    pattern = library.build(name)
    yarn = YarnMaterial.preset(library.structure(name).material)
    sheet = YarnSheet.of(pattern, 3, 3)
    springs = glue(sheet, yarn)
    own, glued = FabricEnergy(sheet, yarn), FabricEnergy(sheet, yarn, springs=springs)
    pulled = sheet.vertices * [1.1, 1.0, 1.0]
    forces = [energy.gradient(energy.vector(pulled, sheet.twist))[1].sum(axis=0) for energy in (own, glued)]
    assert np.linalg.norm(forces[1] - forces[0]) < 1e-2 * np.linalg.norm(forces[0])
    border = np.unique(springs.pairs)
    sag = 9.81 * own.masses()[border].sum() / springs.stiffness.sum()
    assert sag < sheet.radius


def test_sizes_that_make_no_sense_are_refused() -> None:
    for columns, rows in ((0, 3), (3, -1), (2.5, 3), (True, 3), (10_000, 10_000)):
        with pytest.raises(InputError):
            YarnSheet.of(STOCKINETTE, columns, rows)  # type: ignore[arg-type]
    for width, height in ((1e-3, 0.1), (0.1, float("nan")), (0.1, float("inf")), (-1.0, 0.1)):
        with pytest.raises(InputError):
            YarnSheet.filling(STOCKINETTE, width, height)
    sheet = YarnSheet.filling(STOCKINETTE, 0.05, 0.04)
    assert sheet.size == pytest.approx((0.048, 0.0405))
    with pytest.raises(InputError, match="line 0"):
        YarnSheet.from_lines([np.zeros((1, 3))], 1e-3)

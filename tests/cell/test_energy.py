"""The energy of a cell: derivatives by fluctuations and by the macroscopic state, contact lists, constraints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.cell.constraints import vertex_tangents
from yarnscale.cell.energy import CellEnergy
from yarnscale.drawing import library
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.material import ContactRule, YarnMaterial
from yarnscale.yarn.pattern import YarnPattern

HYLC = YarnMaterial.preset("hylc2020-stockinette")
STIFF = replace(HYLC, bending_scale=1.0)
EST = replace(HYLC, contact=ContactRule(kernel="est2022", outer_radius_ratio=1.2, weights="simpson"))
STATES = {
    "rest": ShellStrain(),
    "flat": ShellStrain(0.15, -0.2, 0.05),
    "bent about y": ShellStrain(0.1, 0.1, 0.0, 70.0),
    "bent about x": ShellStrain(-0.05, 0.0, 0.1, 0.0, 0.0, -90.0),
    "bent askew": ShellStrain(0.1, -0.1, 0.1, 40.0, 20.0, 10.0),
}


def pattern() -> YarnPattern:
    """A stockinette of few vertices: every kind of stencil, quickly differenced."""
    return library.build("stockinette", vertices_per_stitch=16)


def disturbed(energy: CellEnergy, seed: int = 0) -> np.ndarray:
    x = energy.start()
    rng = np.random.default_rng(seed)
    n = energy.count
    return x + np.concatenate([0.1 * rng.normal(size=3 * n), 0.3 * rng.normal(size=n)])


def dense(model) -> np.ndarray:  # type: ignore[no-untyped-def]
    at, values = model.pattern, model.values(0.0)
    matrix = np.zeros((at.size, at.size))
    matrix[at.rows, np.repeat(np.arange(at.size), np.diff(at.starts))] = values
    return matrix + np.tril(matrix, -1).T


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("material", [STIFF, EST], ids=["hylc2020", "est2022"])
def test_gradient_and_hessian_against_differences(state: str, material: YarnMaterial) -> None:
    energy = CellEnergy(pattern(), material, STATES[state], symmetric=state.startswith("bent"))
    x = disturbed(energy)
    value, gradient, model = energy.quadratic(x)
    assert value == pytest.approx(energy.value(x), rel=1e-12)
    assert energy.gradient(x)[0] == pytest.approx(value, rel=1e-12)
    np.testing.assert_allclose(energy.gradient(x)[1], gradient, rtol=1e-8, atol=1e-10)
    hessian = dense(model)
    rng, step = np.random.default_rng(1), 1e-6
    directions = [np.eye(len(x))[k] for k in (0, 4, 3 * energy.count - 1, 3 * energy.count, len(x) - 1)]
    directions += list(rng.normal(size=(5, len(x))) / np.sqrt(len(x)))
    for d in directions:
        slope = (energy.value(x + step * d) - energy.value(x - step * d)) / (2 * step)
        assert slope == pytest.approx(gradient @ d, rel=1e-5, abs=1e-6 * np.abs(gradient).max())
        curve = (energy.gradient(x + step * d)[1] - energy.gradient(x - step * d)[1]) / (2 * step)
        # A quadrature point that enters the reach bends the published kernel; 1e-4 covers its share.
        np.testing.assert_allclose(hessian @ d, curve, atol=1e-4 * np.abs(hessian).max())
    assert np.abs(gradient[: 3 * energy.count]).min() > 0
    assert (np.diag(hessian) != 0).all()


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("material", [STIFF, EST], ids=["hylc2020", "est2022"])
def test_stress_at_fixed_fluctuation_against_differences(state: str, material: YarnMaterial) -> None:
    """All six components, at a state that is no equilibrium: positions, frames and contacts follow the state."""
    base = STATES[state]
    at = CellEnergy(pattern(), material, base, symmetric=True)
    x = disturbed(at, 2)
    stress = at.stress(x)
    unit = at.unit / at.pattern.area
    for k in range(6):
        step = np.eye(6)[k] * (1e-6 if k < 3 else 1e-3)
        sides = [
            CellEnergy(at.pattern, material, ShellStrain.from_vector(base.vector + s * step), symmetric=True)
            for s in (1, -1)
        ]
        expected = (sides[0].value(x) - sides[1].value(x)) * unit / (2 * step[k])
        assert abs(expected) > 1e-6
        assert stress[k] == pytest.approx(expected, rel=2e-6, abs=1e-6 * np.abs(stress[: 3 if k < 3 else 6]).max())


@pytest.mark.parametrize("state", ["rest", "flat", "bent about y", "bent askew"])
def test_counting_pairs_from_both_sides_changes_nothing(state: str) -> None:
    """True for flat and singly curved states, whose copies are related by rigid motions."""
    energies = [CellEnergy(pattern(), HYLC, STATES[state], symmetric=s) for s in (False, True)]
    x = disturbed(energies[0])
    (one, slope), (other, same) = (e.gradient(x) for e in energies)
    assert one == pytest.approx(other, rel=1e-10)
    np.testing.assert_allclose(slope, same, atol=1e-9 * np.abs(slope).max())
    np.testing.assert_allclose(energies[0].stress(x)[:3], energies[1].stress(x)[:3], rtol=1e-8, atol=1e-10)


def test_the_energy_does_not_depend_on_the_history_of_contact_lists() -> None:
    energy = CellEnergy(pattern(), HYLC, ShellStrain(0.1))
    rng = np.random.default_rng(0)
    path = [disturbed(energy)]
    for _ in range(30):
        path.append(path[-1] + 0.08 * rng.normal(size=len(path[0])))
    walked = [energy.quadratic(x)[:2] for x in path]
    for x, (value, gradient) in zip(path[::6], walked[::6], strict=True):
        fresh = CellEnergy(pattern(), HYLC, ShellStrain(0.1)).gradient(x)
        assert value == pytest.approx(fresh[0], rel=1e-11)
        np.testing.assert_allclose(gradient, fresh[1], atol=1e-10 * np.abs(gradient).max())


def test_shift_adds_a_positive_diagonal() -> None:
    energy = CellEnergy(pattern(), HYLC, ShellStrain())
    model = energy.quadratic(energy.start())[2]
    difference = model.values(0.5) - model.values(0.0)
    diagonal = difference[model.pattern.diagonal]
    assert (diagonal > 0).all()
    assert np.count_nonzero(difference) == len(diagonal)


def test_constraints_are_those_of_the_theory() -> None:
    """Σ w û = 0, Σ l θ = 0 and no net sliding of each yarn; rows are independent, and the start meets them."""
    fabric = library.build("plain")
    for sliding in (False, True):
        energy = CellEnergy(fabric, HYLC, ShellStrain(0.1, 0.1), sliding=sliding)
        matrix, n = energy.constraints.matrix, energy.count
        np.testing.assert_allclose(matrix @ matrix.T, np.eye(len(matrix)), atol=1e-10)
        np.testing.assert_allclose(matrix @ energy.start(), energy.constraints.right, atol=1e-12)
        shift = np.zeros((n, 3))
        shift[:, 2] = 1.0
        vector = np.concatenate([shift.ravel(), np.zeros(n)])
        assert np.linalg.norm(energy.constraints.project(vector)) < np.linalg.norm(vector), "translation is held"
        yarn = np.concatenate([np.zeros(3 * n), np.isin(np.arange(n), fabric.yarns[0])])
        assert np.abs(matrix @ yarn).max() > 1e-3, "twist of each yarn is held"
        tangent = np.zeros((n, 3))
        tangent[fabric.yarns[0]] = vertex_tangents(fabric)[fabric.yarns[0]]
        slide = np.concatenate([tangent.ravel(), np.zeros(n)])
        held = np.linalg.norm(slide) - np.linalg.norm(energy.constraints.project(slide))
        assert held > (0.0 if sliding else 0.2 * np.linalg.norm(slide))


def test_the_bound_limits_moves_and_gaps() -> None:
    energy = CellEnergy(pattern(), HYLC, ShellStrain())
    x = energy.start()
    rng = np.random.default_rng(3)
    gaps = energy.gaps(x)
    for size in (1e-3, 1.0, 100.0):
        step = size * rng.normal(size=len(x))
        fraction = energy.bound(x, step)
        assert 0 < fraction <= 1
        moves = np.linalg.norm((fraction * step[: 3 * energy.count]).reshape(-1, 3), axis=1)
        assert moves.max() <= 0.3 * (1 + 1e-12)
        assert np.abs(fraction * step[3 * energy.count :]).max() <= 1.0 + 1e-12
        # Pairs that were close stay apart: at least a fifth of their distance is left.
        assert energy.gaps(x + fraction * step).min() >= 0.2 * gaps.min() * (1 - 1e-9)


def test_far_reaching_contact_finds_all_copies() -> None:
    """An outer radius of several yarn radii touches more tiles than the yarns themselves do."""
    fabric = library.build("plain")
    rule = ContactRule(kernel="est2022", outer_radius_ratio=8.0)
    material = replace(HYLC, contact=rule)
    one = CellEnergy(fabric, material, ShellStrain())
    many = CellEnergy(fabric.repeated(3, 3), material, ShellStrain())
    x = one.start()
    n = one.count
    tiled = np.concatenate([np.tile(x[: 3 * n], 9), np.tile(x[3 * n :], 9)])
    assert many.value(tiled) == pytest.approx(9 * one.value(x), rel=1e-11)


def test_parts_add_up() -> None:
    energy = CellEnergy(pattern(), HYLC, ShellStrain(0.2))
    x = disturbed(energy)
    parts = energy.parts(x)
    assert set(parts) == {"stretch", "bend_twist", "contact"} and min(parts.values()) > 0
    assert sum(parts.values()) == pytest.approx(energy.value(x) * energy.unit / energy.pattern.area)

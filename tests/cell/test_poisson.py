"""The least-squares midsurface: observed order, cylinders, its domain, derivatives, and cells that relax on it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.cell.energy import CellEnergy
from yarnscale.cell.midsurface import Midsurface
from yarnscale.cell.poisson import Grid, PoissonMidsurface, cell_midsurface
from yarnscale.drawing import library
from yarnscale.files.patterns import read_pattern
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.material import YarnMaterial

PERIOD = np.array([1.0, 1.2])
CYLINDERS = [ShellStrain(0.1, 0.2, -0.1, 0.4, 0.2, 0.1), ShellStrain(0.0, 0.0, 0.0, 0.0, 0.0, -0.8)]
DOME, SADDLE = ShellStrain(0.1, 0.2, -0.1, 0.5, 0.0, 0.5), ShellStrain(0.0, 0.0, 0.0, 0.5, 0.1, -0.5)
TWIST = ShellStrain(II12=0.5)
DOUBLY_CURVED = [DOME, SADDLE, TWIST]
CELLS = np.array([8, 16, 32])


def points(count: int = 200, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-1.4, 1.4, (count, 2)), rng.uniform(-0.3, 0.3, count)])


def surface(strain: ShellStrain, **options: object) -> PoissonMidsurface:
    return PoissonMidsurface(strain, period=PERIOD, margin=PERIOD, **options)  # type: ignore[arg-type]


def observed_order(errors: list[float]) -> float:
    return float(-np.polyfit(np.log(CELLS), np.log(errors), 1)[0])


def position(strain: ShellStrain, reference: np.ndarray, u: np.ndarray, **options: object) -> np.ndarray:
    place, turn = surface(strain, **options).at(reference)
    return place + np.einsum("nij,nj->ni", turn, u)


# --- the surface ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("strain", DOUBLY_CURVED)
def test_order_two_against_a_fine_grid(strain: ShellStrain) -> None:
    reference = points()
    fine, _ = surface(strain, cells=256).at(reference)
    errors = [np.abs(surface(strain, cells=int(c)).at(reference)[0] - fine).max() for c in CELLS]
    assert errors[0] > 1e-5
    assert observed_order(errors) == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("strain", [*CYLINDERS, ShellStrain(0.2, -0.3, 0.1)])
def test_cylinders_are_exact_around_the_closed_form(strain: ShellStrain) -> None:
    reference = points()
    place, turn = surface(strain).at(reference)
    exact, rotation = Midsurface(strain).at(reference)
    np.testing.assert_allclose(place, exact, atol=1e-14)
    np.testing.assert_allclose(turn, rotation, atol=1e-15)


@pytest.mark.parametrize("strain", CYLINDERS)
def test_another_centre_moves_a_cylinder_rigidly(strain: ShellStrain) -> None:
    reference = points(40)
    place, turn = surface(strain, centre=(0.3, -0.2)).at(reference)
    exact, rotation = Midsurface(strain).at(reference)
    move = turn[0] @ rotation[0].T
    np.testing.assert_allclose(turn, move @ rotation, atol=1e-13)
    np.testing.assert_allclose(place - place[0], (exact - exact[0]) @ move.T, atol=1e-13)


@pytest.mark.parametrize("strain", DOUBLY_CURVED)
def test_point_and_frame_at_the_centre(strain: ShellStrain) -> None:
    centre = np.array([0.3, -0.2, 0.0])
    place, turn = surface(strain, centre=centre[:2]).at(centre[None])
    flat, _ = Midsurface(ShellStrain(strain.s_x, strain.s_a, strain.s_y)).at(centre[None])
    np.testing.assert_allclose(place, flat, atol=1e-14)
    np.testing.assert_allclose(turn[0], np.eye(3), atol=1e-15)


@pytest.mark.parametrize("margin", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("strain", DOUBLY_CURVED)
def test_the_tile_keeps_its_mean_gradient(strain: ShellStrain, margin: float) -> None:
    """∫ ∇φ = ∫ R S over the tile (HYLC20 eq. 16–17 on the element itself), whatever the domain around it."""
    solved = PoissonMidsurface(strain, period=PERIOD, margin=margin * PERIOD, cells=32)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    across, along = np.meshgrid(nodes * PERIOD[0] / 2, nodes * PERIOD[1] / 2, indexing="ij")
    inside = np.stack([across.ravel(), along.ravel(), 0 * along.ravel()], axis=1)
    frames = solved.at(inside)[1]
    weight = np.outer(weights, weights).ravel() / 4
    stretch = np.array([Midsurface(strain).at(np.eye(3)[None, a] * 1e-7)[0][0] / 1e-7 for a in (0, 1)]).T
    wanted = np.einsum("n,nij->ij", weight, frames)
    for axis in (0, 1):
        sides = inside.copy(), inside.copy()
        sides[0][:, axis], sides[1][:, axis] = -PERIOD[axis] / 2, PERIOD[axis] / 2
        gain = weight @ (solved.at(sides[1])[0] - solved.at(sides[0])[0]) / PERIOD[axis]
        np.testing.assert_allclose(gain, (wanted @ stretch)[:, axis], atol=3e-4)


def test_the_tile_hardly_depends_on_the_domain() -> None:
    """With its own mean gradient kept, only a small part of det II · p² (here 0.2) is left of the choice of domain."""
    corner, strain = np.array([[0.5, 0.6, 0.0]]), ShellStrain(II11=0.4, II22=0.4)
    place = [PoissonMidsurface(strain, period=PERIOD, margin=m * PERIOD).at(corner)[0] for m in (1.0, 2.0)]
    assert 0.0 < float(np.linalg.norm(place[1] - place[0])) < 2e-3


@pytest.mark.parametrize("strain", [*CYLINDERS, *DOUBLY_CURVED, ShellStrain(0.1, 0.2, 0.3)])
def test_derivatives_by_the_state(strain: ShellStrain) -> None:
    options = {"centre": (0.2, 0.1)}
    reference, u = points(30), np.random.default_rng(1).normal(size=(30, 3))
    places, turns = surface(strain, **options).slopes(reference)
    exact = places + np.einsum("nijl,nj->nil", turns, u)
    assert (np.abs(exact).max(axis=(0, 1)) > 1e-2).all()
    step = 1e-5
    for k in range(6):
        move = step * np.eye(6)[k]
        sides = [
            position(ShellStrain.from_vector(strain.vector + sign * move), reference, u, **options) for sign in (1, -1)
        ]
        np.testing.assert_allclose(exact[:, :, k], (sides[0] - sides[1]) / (2 * step), atol=1e-8)


@pytest.mark.parametrize("strain", [*CYLINDERS, *DOUBLY_CURVED, ShellStrain(0.1, 0.2, 0.3)])
def test_second_derivatives_by_the_state(strain: ShellStrain) -> None:
    generator, reference = np.random.default_rng(2), points(30)
    forces, turns = generator.normal(size=(30, 3)), generator.normal(size=(30, 3, 3))

    def loaded(vector: np.ndarray) -> np.ndarray:
        places, rotations = surface(ShellStrain.from_vector(vector), centre=(0.2, 0.1)).slopes(reference)
        return np.einsum("ni,nil->l", forces, places) + np.einsum("nij,nijl->l", turns, rotations)

    exact = surface(strain, centre=(0.2, 0.1)).second(reference, forces, turns)
    for k, move in enumerate(1e-5 * np.eye(6)):
        expected = (loaded(strain.vector + move) - loaded(strain.vector - move)) / 2e-5
        np.testing.assert_allclose(exact[k], expected, atol=1e-7 * np.abs(exact).max())


def test_the_unit_of_length_drops_out() -> None:
    reference, length = points(20), 1e-3
    strain = ShellStrain(0.1, 0.0, 0.0, 300.0, 50.0, -200.0)
    in_unit = PoissonMidsurface(strain, period=PERIOD, length=length)
    in_metres = PoissonMidsurface(strain, period=PERIOD * length)
    np.testing.assert_allclose(in_unit.at(reference)[0] * length, in_metres.at(reference * length)[0], atol=1e-15)
    np.testing.assert_allclose(
        in_unit.slopes(reference)[0] * length, in_metres.slopes(reference * length)[0], atol=1e-14
    )


def test_beyond_the_domain_the_correction_stays() -> None:
    far = np.array([[40.0, -30.0, 0.0]])
    place, _ = surface(SADDLE).at(far)
    assert np.isfinite(place).all() and np.linalg.norm(place - Midsurface(SADDLE).at(far)[0]) < 1


@pytest.mark.parametrize("cells", [0, 2, 10])
def test_grids_of_other_counts_are_refused(cells: int) -> None:
    with pytest.raises(ValueError, match="multiple of 4"):
        Grid((1.0, 1.0), (1.0, 1.0), cells)


# --- cells on it ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def plain() -> PeriodicCell:
    return PeriodicCell(library.build("plain"), YarnMaterial.preset("hylc2020-basket")).with_options(tolerance=1e-9)


@pytest.fixture(scope="module")
def stockinette(shared: Path) -> PeriodicCell:
    pattern = read_pattern(shared / "reference" / "stockinette.pyp")
    return PeriodicCell(pattern, YarnMaterial.preset("hylc2020-stockinette")).with_options(tolerance=1e-9)


RELAXED = [(50.0, 50.0), (-50.0, -50.0), (50.0, -50.0), (-50.0, 50.0)]


def stress_by_energies(cell: PeriodicCell, strain: ShellStrain, fraction: float) -> np.ndarray:
    state = cell.relax(strain)
    assert state.converged
    steps = fraction * np.array([2e-5] * 3 + [2e-2] * 3)
    slopes = np.empty(6)
    for k, step in enumerate(steps):
        sides = [
            cell.relax(ShellStrain.from_vector(strain.vector + sign * step * np.eye(6)[k]), start=state)
            for sign in (1, -1)
        ]
        assert all(side.converged for side in sides)
        slopes[k] = (sides[0].energy_density - sides[1].energy_density) / (2 * step)
    error = np.abs(slopes - state.stress)
    return np.array([error[:3].max() / np.abs(slopes[:3]).max(), error[3:].max() / np.abs(slopes[3:]).max()])


@pytest.mark.parametrize(("course", "wale"), RELAXED)
def test_domes_and_saddles_relax(plain: PeriodicCell, course: float, wale: float) -> None:
    state = plain.relax(ShellStrain(II11=course, II22=wale))
    assert state.converged and state.energy_density > 0


@pytest.mark.parametrize(("course", "wale"), RELAXED)
def test_domes_and_saddles_of_stockinette_relax(stockinette: PeriodicCell, course: float, wale: float) -> None:
    state = stockinette.relax(ShellStrain(II11=course, II22=wale))
    assert state.converged and state.energy_density > 0


@pytest.mark.parametrize("strain", [ShellStrain(II11=50, II22=50), ShellStrain(II11=50, II22=-50)])
def test_stress_of_a_woven_cell(plain: PeriodicCell, strain: ShellStrain) -> None:
    assert (stress_by_energies(plain, strain, 1.0) < 1e-5).all()


@pytest.mark.parametrize("strain", [ShellStrain(II11=50, II22=50), ShellStrain(II11=50, II22=-50)])
def test_stress_of_a_knitted_cell(stockinette: PeriodicCell, strain: ShellStrain) -> None:
    # A soft state: with wider steps the differences, not the stress, are off by 2e-5.
    assert (stress_by_energies(stockinette, strain, 0.1) < 1e-5).all()


def test_stress_that_leads_off_a_cylinder(plain: PeriodicCell) -> None:
    """At a singly curved state the other curvature has a slope too: that of the surface for det II ≠ 0."""
    assert (stress_by_energies(plain, ShellStrain(0.1, 0.05, 0.0, 50.0), 1.0) < 1e-5).all()


def test_energy_runs_smoothly_through_cylinders(plain: PeriodicCell) -> None:
    """Ψ(II22) at fixed II11 has no step at det II = 0: what is left after the tangent falls with the square."""
    state = plain.relax(ShellStrain(II11=50.0))
    sizes = np.array([8.0, 4.0, 2.0])
    for sign in (1.0, -1.0):
        rest = []
        for size in sizes:
            near = plain.relax(ShellStrain(II11=50.0, II22=sign * size), start=state)
            rest.append(abs(near.energy_density - state.energy_density - state.stress[5] * sign * size))
        assert np.polyfit(np.log(sizes), np.log(rest), 1)[0] == pytest.approx(2.0, abs=0.25)


def test_singly_curved_cells_have_the_energy_of_the_closed_form(plain: PeriodicCell) -> None:
    strain = ShellStrain(0.1, 0.0, 0.05, 60.0)
    energy = plain.energy(strain)
    x = energy.start()
    closed = Midsurface(strain, length=plain.pattern.radius)
    place, turn = energy.surface.at(energy.reference)
    exact, rotation = closed.at(energy.reference)
    move = turn[0] @ rotation[0].T
    np.testing.assert_allclose(place - place[0], (exact - exact[0]) @ move.T, atol=1e-12)
    one_sided = CellEnergy(plain.pattern, plain.material, strain, plain.sliding, False)
    assert energy.value(x) == pytest.approx(one_sided.value(x), rel=1e-10)


def test_moduli_of_a_dome(plain: PeriodicCell) -> None:
    strain = ShellStrain(0.05, 0.0, 0.02, 40.0, 0.0, 30.0)
    # Differences of stresses, whose error is of first order in the residual, ask for a tight one. Moduli jump by
    # 0.4 % between 2e-6 and 6e-6 of strain or curvature/1000 away: within, differences agree to 6e-7, beyond to 2e-3.
    cell = plain.with_options(tolerance=1e-12)
    state = cell.relax(strain)
    moduli = cell.moduli(state)
    np.testing.assert_array_equal(moduli, moduli.T)
    scale = np.sqrt(np.abs(np.diag(moduli)))
    steps = np.array([2e-6] * 3 + [2e-3] * 3)
    for k, step in enumerate(steps):
        sides = [
            cell.relax(ShellStrain.from_vector(strain.vector + sign * step * np.eye(6)[k]), start=state).stress
            for sign in (1, -1)
        ]
        error = ((sides[0] - sides[1]) / (2 * step) - moduli[k]) / (scale[k] * scale)
        assert np.abs(error).max() < 1e-5


def test_the_domain_is_given_by_the_pattern(plain: PeriodicCell) -> None:
    """Not by the search for contacts, which looks farther in compressed states."""
    loose, pressed = (cell_midsurface(plain.pattern, ShellStrain(s, 0.0, s, 50.0, 0.0, 50.0)) for s in (0.5, -0.4))
    assert isinstance(loose, PoissonMidsurface) and isinstance(pressed, PoissonMidsurface)
    for a, b in zip(loose.grid.nodes, pressed.grid.nodes, strict=True):
        np.testing.assert_array_equal(a, b)


def test_energy_does_not_depend_on_where_the_pattern_is_drawn(plain: PeriodicCell) -> None:
    shift = np.array([0.37e-3, -1.1e-3, 0.0])
    moved = replace(plain.pattern, vertices=plain.pattern.vertices + shift)
    strain = ShellStrain(0.02, 0.0, 0.0, 50.0, 10.0, 30.0)
    here, there = (PeriodicCell(p, plain.material).energy(strain) for p in (plain.pattern, moved))
    assert there.value(there.start()) == pytest.approx(here.value(here.start()), rel=1e-10)

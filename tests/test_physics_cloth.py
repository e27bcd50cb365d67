"""Cloth against closed forms: homogeneous strain, cylinder, heavy strip, hanging chain, elastica, free flight.

Each test states its equation. Where a discretisation error is left, it must shrink as the mesh is refined, at the
rate that the method has.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad, solve_bvp
from scipy.optimize import brentq

from yarnscale.files.material_json import read_material
from yarnscale.motion.handles import Handle
from yarnscale.motion.integrator import Integrator
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.numerics.newton import Status
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver, SolverOptions
from yarnscale.shell.elastic.energy import ShellEnergy
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
from yarnscale.shell.mesh import TriangleMesh, rectangle
from yarnscale.shell.state import ClothState

Floats = NDArray[np.float64]
GRAVITY = 9.81


def cloth_of(*, stretch: float = 90.0, bend: float = 2e-5, density: float = 0.2) -> OrthotropicMaterial:
    """Cloth whose threads do not couple; ψ = ½ k E11² + … + bend·κ², so that EI per width is 2·bend."""
    return OrthotropicMaterial(
        stretch_weft=stretch,
        stretch_coupling=0.0,
        stretch_warp=stretch,
        shear=20.0,
        bend_weft=bend,
        bend_bias=bend,
        bend_warp=bend,
        density=density,
    )


def held(mesh: TriangleMesh, places: Floats, which: NDArray[np.bool_]) -> Handle:
    vertices = np.flatnonzero(which)
    return Handle("held", vertices, places[vertices])


def equilibrium_of(cloth: Cloth, start: ClothState, *, tolerance: float = 1e-5) -> ClothState:
    solver = ClothSolver(cloth, SolverOptions(tolerance=tolerance))
    run = simulate(solver, start, Schedule(0.0, 0.05, rest_tolerance=10 * tolerance, max_rest_steps=60))
    result = solver.step(run.state, math.inf)
    assert result.status is Status.CONVERGED
    return result.state


def observed_order(errors: list[float]) -> float:
    """Slope of log error over log spacing, for spacings that halve."""
    return float(np.log2(errors[0] / errors[-1]) / (len(errors) - 1))


def test_flat_cloth_without_stress_is_at_rest() -> None:
    """∇E = 0 where I = 1 and II = 0, for a material whose rest is flat, turned and moved anywhere."""
    mesh = rectangle(0.06, 0.05, 0.008)
    energy = ShellEnergy(mesh, cloth_of())
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    positions = ClothState.flat(mesh).positions @ turn.T + [0.3, -0.2, 1.0]
    force = energy.linearise(positions).gradient
    assert np.abs(force).max() < 1e-13 * 90.0


@pytest.mark.parametrize("name", ["stock1", "satin1"])
def test_homogeneous_stretch_has_the_energy_and_force_of_the_material(shared: Path, name: str) -> None:
    """E = A ψ(s) exactly, on any mesh (patch test); inner vertices feel no force."""
    material = read_material(shared / "reference" / f"{name}.json")
    mesh = rectangle(0.06, 0.05, 0.008)
    energy = ShellEnergy(mesh, material)
    stretch_x, shear, stretch_y = 0.12, 0.05, 0.07
    gradient = np.array([[1 + stretch_x, shear], [0.0, math.sqrt((1 + stretch_y) ** 2 - shear**2)]])
    positions = np.column_stack([mesh.panel @ gradient.T, np.zeros(mesh.vertex_count)])
    strain = [stretch_x, shear / (1 + stretch_y), stretch_y, 0.0, 0.0, 0.0]
    linear = energy.linearise(positions)
    assert linear.value == pytest.approx(0.06 * 0.05 * float(material.energy_density(strain)), rel=1e-12)
    inner = (np.abs(mesh.panel) < np.array([0.03, 0.025]) - 1e-9).all(axis=1)
    scale = float(np.abs(material.stress(strain)).max()) * 0.008
    assert np.abs(linear.gradient[inner, :2]).max() < 1e-10 * scale


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0), (0.6, 0.8)])
def test_a_cylinder_has_its_bending_energy(direction: tuple[float, float]) -> None:
    """E = A·bend/R² for a sheet rolled about any axis; the rows at the edges leave an error of first order."""
    radius, bend, (a, b) = 0.05, 2e-5, direction
    errors = []
    for spacing in (0.01, 0.005, 0.0025):
        mesh = rectangle(0.1, 0.1, spacing)
        energy = ShellEnergy(mesh, cloth_of(stretch=0.0, bend=bend))
        along, across = mesh.panel @ [a, b], mesh.panel @ [-b, a]
        axis, roll = np.array([-b, a, 0.0]), np.array([a, b, 0.0])
        positions = np.outer(radius * np.sin(along / radius), roll) + np.outer(across, axis)
        positions[:, 2] = radius * (1 - np.cos(along / radius))
        energy.follow(positions)
        membrane = ShellEnergy(mesh, cloth_of(stretch=0.0, bend=0.0)).value(positions)
        errors.append(abs((energy.value(positions) - membrane) / (0.01 * bend / radius**2) - 1))
    assert errors[-1] < 0.02
    assert errors[-1] < 0.005 or observed_order(errors) > 0.75


def test_a_heavy_strip_stretches_by_its_own_weight() -> None:
    """k/2 (λ² − 1) λ = ρ g s at the height s above the lower end; its length is ∫ λ ds."""
    stretch, length, density = 20.0, 0.2, 2.0
    material = cloth_of(stretch=stretch, density=density)

    def ratio(s: float) -> float:
        load = density * GRAVITY * s
        return brentq(lambda x: 0.5 * stretch * (x * x - 1) * x - load, 1.0, 3.0)

    expected = quad(ratio, 0.0, length)[0]
    errors = []
    for spacing in (0.02, 0.01, 0.005):
        mesh = rectangle(0.02, length, spacing)
        flat = ClothState.flat(mesh)
        top = held(mesh, flat.positions, mesh.panel[:, 1] > 0.5 * length - 1e-9)
        state = equilibrium_of(Cloth(mesh, material, (top,), gravity=(0.0, -GRAVITY, 0.0)), flat)
        lower = mesh.panel[:, 1] < -0.5 * length + 1e-9
        errors.append(abs(0.5 * length - state.positions[lower, 1].mean() - expected) / expected)
    assert errors[-1] < 1e-3
    assert observed_order(errors) > 0.9


def test_a_strip_between_two_hands_hangs_as_a_chain() -> None:
    """Limp and stiff in tension, a strip of length L between hands d apart is a catenary, L = 2a sinh(d/2a)."""
    length, distance = 0.2, 0.15
    a = brentq(lambda a: 2 * a * math.sinh(distance / (2 * a)) - length, 0.03, 1.0)
    expected = a * (math.cosh(distance / (2 * a)) - 1)
    errors = []
    for spacing in (0.02, 0.01):
        mesh = rectangle(length, 0.02, spacing)
        start = sagging(mesh, length, distance)
        ends = held(mesh, start.positions, np.abs(mesh.panel[:, 0]) > 0.5 * length - 1e-9)
        cloth = Cloth(mesh, cloth_of(stretch=3000.0, bend=1e-9), (ends,))
        state = equilibrium_of(cloth, start, tolerance=1e-4)
        errors.append(abs(-state.positions[:, 2].min() / expected - 1))
    assert errors[-1] < 5e-3
    assert errors[-1] < 0.5 * errors[0]


def sagging(mesh: TriangleMesh, length: float, distance: float) -> ClothState:
    """The strip as an arc of a circle between the hands, undeformed."""
    half = brentq(lambda h: math.sin(h) / h - distance / length, 0.1, 3.0)
    radius, angle = 0.5 * length / half, mesh.panel[:, 0] / (0.5 * length) * half
    positions = np.column_stack([radius * np.sin(angle), mesh.panel[:, 1], radius * (math.cos(half) - np.cos(angle))])
    return ClothState(positions, np.zeros_like(positions))


def test_a_heavy_cantilever_bends_as_the_elastica() -> None:
    """EI θ'' = ρ g (L − s) cos θ with θ(0) = 0, θ'(L) = 0, beyond small angles: the tip of a long strip."""
    length, bend, density = 0.08, 2e-5, 0.2
    ratio = density * GRAVITY / (2 * bend)
    solution = solve_bvp(
        lambda s, y: np.array([y[1], ratio * (length - s) * np.cos(y[0])]),
        lambda start, end: np.array([start[0], end[1]]),
        np.linspace(0.0, length, 60),
        np.zeros((2, 60)),
        tol=1e-8,
    )
    expected = quad(lambda s: math.sin(solution.sol(s)[0]), 0.0, length)[0]
    assert abs(expected) > 0.5 * length  # far from Euler–Bernoulli's small angles
    errors = []
    for spacing in (0.008, 0.004, 0.002):
        # Half a triangle beyond the clamped rows still holds the slope: the free length ends in their middle.
        mesh = rectangle(length + spacing, 0.02, spacing)
        flat, along = ClothState.flat(mesh), mesh.panel[:, 0]
        clamp = held(mesh, flat.positions, along < along.min() + 1.5 * spacing)
        state = equilibrium_of(Cloth(mesh, cloth_of(stretch=400.0, bend=bend), (clamp,)), flat)
        tip = along > along.max() - 1e-9
        errors.append(abs(-state.positions[tip, 2].mean() / abs(expected) - 1))
    assert errors[-1] < 0.03
    assert observed_order(errors) > 0.7


@pytest.mark.parametrize(("integrator", "order"), [("euler", 1.0), ("bdf2", 2.0)])
def test_free_flight_keeps_momentum_and_loses_energy_at_the_order_of_the_rule(
    integrator: Integrator, order: float
) -> None:
    """P = P0 + m g t exactly. Energy is lost, never gained, and angular momentum lost, by O(Δtᵖ) or less."""
    mesh = rectangle(0.05, 0.04, 0.012)
    cloth = Cloth(mesh, cloth_of(bend=2e-4))
    options = SolverOptions(tolerance=1e-9, integrator=integrator, minimiser="newton")
    flat = ClothState.flat(mesh).positions
    spin, drift = np.array([4.0, 7.0, 3.0]), np.array([0.3, -0.1, 0.5])
    start = ClothState(flat, np.cross(spin, flat) + drift)
    duration, losses = 0.02, []
    for count in (20, 40, 80):
        solver = ClothSolver(cloth, options)
        run = simulate(solver, start, Schedule(duration, duration / count, to_rest=False))
        mass = solver.masses
        momentum = mass @ run.state.velocities
        expected = mass.sum() * (drift + np.array(cloth.gravity) * duration)
        np.testing.assert_allclose(momentum, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
        before, after = angular_momentum(mass, start), angular_momentum(mass, run.state)
        lost = np.linalg.norm(after - before) / np.linalg.norm(before)
        energy = [inner_energy(solver, state) for state in (start, run.state)]
        assert energy[1] < energy[0]
        losses.append([lost, 1 - energy[1] / energy[0]])
    orders = [observed_order([loss[k] for loss in losses]) for k in (0, 1)]
    assert min(orders) > order - 0.35


def angular_momentum(masses: Floats, state: ClothState) -> Floats:
    """About the centre of mass [kg m²/s], (3,)."""
    centre = masses @ state.positions / masses.sum()
    return np.cross(state.positions - centre, masses[:, None] * state.velocities).sum(axis=0)


def inner_energy(solver: ClothSolver, state: ClothState) -> float:
    """Elastic energy and kinetic energy relative to the centre of mass [J]."""
    relative = state.velocities - solver.masses @ state.velocities / solver.masses.sum()
    return solver.energy.value(state.positions) + 0.5 * float(solver.masses @ (relative**2).sum(axis=1))

"""Implicit rules of time: observed order, steps that change, and Rayleigh damping against the damped oscillator."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.motion.handles import Handle
from yarnscale.motion.integrator import Earlier, Integrator, step_rule
from yarnscale.motion.rigid import Motion
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver, SolverOptions
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
from yarnscale.shell.mesh import rectangle
from yarnscale.shell.state import ClothState

STRETCH, DENSITY = 60.0, 0.2


def fabric() -> OrthotropicMaterial:
    return OrthotropicMaterial(
        stretch_weft=STRETCH,
        stretch_coupling=0.0,
        stretch_warp=90.0,
        shear=20.0,
        bend_weft=2e-5,
        bend_bias=2e-5,
        bend_warp=2e-5,
        density=DENSITY,
    )


def kicked(integrator: Integrator, *, stiffness_damping: float = 0.0) -> tuple[ClothSolver, ClothState]:
    """A small sheet without gravity that is stretched, sheared and bent by its first velocities."""
    mesh = rectangle(0.05, 0.04, 0.012)
    cloth = Cloth(mesh, fabric(), gravity=(0.0, 0.0, 0.0), stiffness_damping=stiffness_damping)
    solver = ClothSolver(cloth, SolverOptions(tolerance=1e-8, integrator=integrator, minimiser="newton"))
    x, y = mesh.panel.T
    velocities = np.column_stack([6.0 * x + 2.0 * y, -3.0 * y, 60.0 * x * x])
    return solver, ClothState(ClothState.flat(mesh).positions, velocities)


def after(integrator: Integrator, steps: Sequence[float]) -> ClothState:
    solver, state = kicked(integrator)
    for step in steps:
        state = solver.step(state, step).state
    return state


@pytest.mark.parametrize(("integrator", "order"), [("euler", 1), ("bdf2", 2)])
@pytest.mark.parametrize("pattern", [(1.0, 1.0), (1.4, 0.6)], ids=["even steps", "uneven steps"])
def test_positions_converge_at_the_order_of_the_rule(
    integrator: Integrator, order: int, pattern: tuple[float, float]
) -> None:
    """Differences between solutions with Δt, Δt/2, Δt/4 shrink by 2ᵖ."""
    duration = 1e-3
    ends = []
    for count in (16, 32, 64):
        steps = [float(share) * duration / count for share in np.tile(pattern, count // 2)]
        ends.append(after(integrator, steps).positions)
    coarse, fine = (np.linalg.norm(b - a) for a, b in itertools.pairwise(ends))
    assert math.log2(coarse / fine) == pytest.approx(order, abs=0.3)
    assert fine < 0.2 * np.linalg.norm(ends[-1] - kicked(integrator)[1].positions)


@pytest.mark.parametrize("integrator", ["euler", "bdf2"])
def test_steps_from_a_480th_to_a_30th_of_a_second_come_to_the_same_shape(integrator: Integrator) -> None:
    """A sheet sags between bars that come closer; all steps are stable, and the shape at rest is the same."""
    mesh = rectangle(0.1, 0.1, 0.012)
    flat = ClothState.flat(mesh).positions
    bars = []
    for side in (-1.0, 1.0):
        row = np.flatnonzero(side * mesh.panel[:, 0] > 0.05 - 1e-9)
        bars.append(Handle(f"bar {side:g}", row, flat[row], Motion((-side * 0.005, 0.0, 0.0), 0.0, 0.1)))
    cloth = Cloth(mesh, fabric(), tuple(bars), damping=2.0)
    shapes = []
    for rate in (480, 120, 30):
        solver = ClothSolver(cloth, SolverOptions(integrator=integrator))
        run = simulate(solver, ClothState.flat(mesh), Schedule(0.2, 1 / rate, rest_tolerance=1e-3))
        assert run.converged and run.loose_steps == 0
        shapes.append(run.state.positions)
    for shape in shapes[1:]:
        assert np.sqrt(((shape - shapes[0]) ** 2).sum(axis=1).mean()) < 1e-4
    assert abs(shapes[0][:, 2]).max() > 2e-3


def test_bdf2_differentiates_parabolas_exactly() -> None:
    """x = a + b t + c t² at uneven times: the rule gives b + 2 c t, and falls back to Euler where it is unstable."""
    rng = np.random.default_rng(0)
    a, b, c = rng.normal(size=(3, 5, 3))
    times = (0.0, 0.1, 0.27)
    x = [a + b * t + c * t * t for t in times]
    v = [b + 2 * c * t for t in times]
    before = Earlier(x[0], v[0], 0.1)
    rule = step_rule("bdf2", x[1], v[1], before, times[2] - times[1])
    np.testing.assert_allclose(rule.velocity(x[2]), v[2], atol=1e-12)
    np.testing.assert_allclose(rule.rate * (v[2] - rule.velocities), 2 * c, atol=1e-11)
    for unstable in (step_rule("bdf2", x[1], v[1], before, 0.25), step_rule("bdf2", x[1], v[1], None, 0.1)):
        np.testing.assert_array_equal(unstable.positions, x[1])
    assert step_rule("bdf2", x[1], v[1], before, 0.25).rate == pytest.approx(4.0)


def test_halved_steps_keep_the_history() -> None:
    """A step that fails is halved; its halves look back at the states before, not at the attempt."""
    mesh = rectangle(0.06, 0.06, 0.01)
    side = np.flatnonzero(mesh.panel[:, 0] > 0.03 - 1e-9)
    flat = ClothState.flat(mesh).positions
    bar = Handle("bar", side, flat[side], Motion((0.05, 0.02, 0.03), 0.0, 0.04))
    options = SolverOptions(tolerance=1e-6, acceptable=1e-6, iterations=6, integrator="bdf2", minimiser="newton")
    solver = ClothSolver(Cloth(mesh, fabric(), (bar,)), options)
    state, shortened = ClothState.flat(mesh), False
    for _ in range(4):
        result = solver.advance(state, 0.01)
        assert result.state is not state and result.state.before is not None
        assert result.state.time == pytest.approx(state.time + result.duration)
        assert result.state.before.duration == pytest.approx(result.duration)
        np.testing.assert_array_equal(result.state.before.positions, state.positions)
        shortened |= result.duration < 0.01
        state = result.state
    assert shortened


def test_damping_by_stiffness_is_that_of_the_damped_oscillator() -> None:
    """u = A sin(πx/2L) e^(−ζωt) cos ω_d t for a bar clamped at one end: ω = (π/2L) √(k/ρ), ζ = βω/2."""
    length, spacing, ratio, amplitude = 0.2, 0.01, 0.1, 1e-4
    mesh = rectangle(length, 0.01, spacing)
    flat = ClothState.flat(mesh).positions
    along = flat[:, 0] + 0.5 * length
    clamp = np.flatnonzero(along < 1e-9)
    frequency = math.pi / (2 * length) * math.sqrt(STRETCH / DENSITY)
    cloth = Cloth(
        mesh,
        fabric(),
        (Handle("clamp", clamp, flat[clamp]),),
        gravity=(0.0, 0.0, 0.0),
        stiffness_damping=2 * ratio / frequency,
    )
    solver = ClothSolver(cloth, SolverOptions(tolerance=1e-6, integrator="bdf2"))
    velocities = np.zeros_like(flat)
    damped = frequency * math.sqrt(1 - ratio**2)
    velocities[:, 0] = amplitude * damped * np.sin(math.pi * along / (2 * length))
    count, period = 60, 2 * math.pi / damped
    run = simulate(solver, ClothState(flat, velocities), Schedule(1.25 * period, period / count, to_rest=False))
    tip = along > length - 1e-9
    moved = (run.state.positions[tip, 0] - flat[tip, 0]).mean() / amplitude
    # After 1¼ periods sin ω_d t = 1 again; the rule's own phase error is 3 % of a radian.
    assert moved == pytest.approx(math.exp(-ratio * frequency * 1.25 * period), rel=0.05)


@pytest.mark.parametrize("integrator", ["euler", "bdf2"])
def test_damping_by_stiffness_leaves_momentum_and_takes_energy(integrator: Integrator) -> None:
    solver, start = kicked(integrator, stiffness_damping=1e-3)
    spin = np.cross([0.0, 0.0, 5.0], start.positions) + np.array([0.2, 0.1, -0.3])
    rigid = ClothState(start.positions, spin)
    free, _ = kicked(integrator)
    ends = [simulate(s, rigid, Schedule(0.02, 1e-3, to_rest=False)).state for s in (solver, free)]
    for state in ends:
        momentum = solver.masses @ state.velocities
        np.testing.assert_allclose(momentum, solver.masses @ spin, atol=1e-12)
    turning = [np.cross(s.positions, solver.masses[:, None] * s.velocities).sum(axis=0)[2] for s in ends]
    assert turning[0] == pytest.approx(turning[1], rel=2e-3)
    shaken = [simulate(s, start, Schedule(0.002, 1e-4, to_rest=False)).state for s in (solver, free)]
    damped, undamped = (sum(free.energies(state).values()) for state in shaken)
    assert damped < 0.7 * undamped


def test_an_unknown_integrator_is_named() -> None:
    with pytest.raises(InputError, match="integrator; expected euler or bdf2"):
        SolverOptions(integrator="leapfrog")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="stiffness_damping; expected zero or more"):
        kicked("euler", stiffness_damping=-1.0)

"""Cloth through time against closed forms: fall, stretch, weight, a cantilever; and failures that lose nothing."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.motion.handles import Handle
from yarnscale.motion.rigid import Motion
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.numerics.newton import Status
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver, SolverOptions
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
from yarnscale.shell.mesh import TriangleMesh, rectangle
from yarnscale.shell.state import ClothState


def fabric(*, bend: float = 2e-5, density: float = 0.2) -> OrthotropicMaterial:
    """Cloth without coupling between course and wale, so that clamps do not disturb uniform stretch."""
    return OrthotropicMaterial(
        stretch_weft=60.0,
        stretch_coupling=0.0,
        stretch_warp=90.0,
        shear=20.0,
        area=0.0,
        log_area=0.0,
        bend_weft=bend,
        bend_bias=bend,
        bend_warp=bend,
        density=density,
    )


def strip(name: str, mesh: TriangleMesh, inside: np.ndarray, motion: Motion | None = None) -> Handle:
    vertices = np.flatnonzero(inside)
    return Handle(name, vertices, ClothState.flat(mesh).positions[vertices], motion or Motion())


def test_free_fall_is_that_of_the_implicit_rule() -> None:
    mesh = rectangle(0.05, 0.05, 0.01)
    solver = ClothSolver(Cloth(mesh, fabric()), SolverOptions(tolerance=1e-8))
    start = ClothState.flat(mesh)
    run = simulate(solver, start, Schedule(0.1, 0.02, to_rest=False))
    fallen = run.state.positions - start.positions
    assert run.converged and run.steps == 5
    np.testing.assert_allclose(fallen[:, 2], -9.81 * 0.02**2 * (5 * 6 / 2), rtol=1e-9)
    np.testing.assert_allclose(fallen[:, :2], 0, atol=1e-12)
    np.testing.assert_allclose(run.state.velocities[:, 2], -9.81 * 0.1, rtol=1e-9)
    assert run.state.time == pytest.approx(0.1)


def test_damping_slows_the_fall_as_the_implicit_rule_says() -> None:
    mesh = rectangle(0.05, 0.05, 0.01)
    solver = ClothSolver(Cloth(mesh, fabric(), damping=3.0), SolverOptions(tolerance=1e-8))
    run = simulate(solver, ClothState.flat(mesh), Schedule(0.1, 0.02, to_rest=False))
    speed = 0.0
    for _ in range(5):
        speed = (speed + 0.02 * 9.81) / (1 + 3.0 * 0.02)
    np.testing.assert_allclose(run.state.velocities[:, 2], -speed, rtol=1e-9)


@pytest.mark.parametrize("axis", [0, 1])
def test_uniform_stretch_pulls_with_stress_times_width(axis: int) -> None:
    mesh = rectangle(0.06, 0.06, 0.01)
    handles = []
    for side in (-1, 1):
        displacement = [0.0, 0.0, 0.0]
        displacement[axis] = side * 0.006
        motion = Motion((displacement[0], displacement[1], displacement[2]), 0.0, 0.2)
        handles.append(strip(f"side {side}", mesh, side * mesh.panel[:, axis] > 0.03 - 1e-9, motion))
    cloth = Cloth(mesh, fabric(), tuple(handles), gravity=(0.0, 0.0, 0.0))
    solver = ClothSolver(cloth, SolverOptions(tolerance=1e-7))
    run = simulate(solver, ClothState.flat(mesh), Schedule(0.2, 0.1, rest_tolerance=1e-7))
    assert run.converged
    strain = np.zeros((1, 6))
    strain[0, 2 * axis] = 0.2
    expected = fabric().stress(strain)[0, 2 * axis] * 0.06
    first, second = (solver.pull(handle, run.state) for handle in handles)
    assert second[axis] == pytest.approx(expected, rel=1e-4)
    np.testing.assert_allclose(first, -second, atol=1e-6)
    expected_positions = mesh.panel.copy()
    expected_positions[:, axis] *= 1.2
    np.testing.assert_allclose(run.state.positions[:, :2], expected_positions, atol=1e-5)


def test_a_hanging_sheet_pulls_with_its_weight() -> None:
    mesh = rectangle(0.06, 0.06, 0.01)
    top = strip("top", mesh, mesh.panel[:, 1] > 0.03 - 1e-9)
    cloth = Cloth(mesh, fabric(), (top,), gravity=(0.0, -9.81, 0.0))
    solver = ClothSolver(cloth)
    run = simulate(solver, ClothState.flat(mesh), Schedule(0.0, 0.05, rest_tolerance=1e-4))
    assert run.converged
    np.testing.assert_allclose(solver.pull(top, run.state), [0, 9.81 * 0.2 * 0.0036, 0], atol=2e-5)
    # Its own weight stretches it: u = ρ g L² / (2 k) in the linear limit.
    sag = -run.state.positions[:, 1].min() - 0.03
    assert sag == pytest.approx(0.2 * 9.81 * 0.06**2 / (2 * 90.0), rel=0.03)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_cantilever_bends_as_a_beam(axis: int) -> None:
    """Deflection ρ g L⁴/(8 EI) with EI = 2 bend per width; both free edges and the clamp are at work."""
    spacing, bend = 0.004, 2e-4
    size = [0.08, 0.024] if axis == 0 else [0.024, 0.08]
    mesh = rectangle(size[0], size[1], spacing)
    across = mesh.panel[:, axis]
    # Two rows: a clamp holds the slope too.
    clamp = strip("clamp", mesh, across < -0.04 + spacing + 1e-9)
    cloth = Cloth(mesh, fabric(bend=bend), (clamp,))
    solver = ClothSolver(cloth, SolverOptions(tolerance=1e-5))
    run = simulate(solver, ClothState.flat(mesh), Schedule(0.0, 0.05, rest_tolerance=1e-4))
    assert run.converged
    tip = across > 0.04 - 1e-9
    length = 0.04 - across[clamp.vertices].max()
    deflection = -run.state.positions[tip, 2].mean()
    assert deflection == pytest.approx(0.2 * 9.81 * length**4 / (8 * 2 * bend), rel=0.08)


def test_a_static_solve_finds_the_same_rest() -> None:
    mesh = rectangle(0.06, 0.06, 0.01)
    top = strip("top", mesh, mesh.panel[:, 1] > 0.03 - 1e-9)
    cloth = Cloth(mesh, fabric(), (top,), gravity=(0.0, -9.81, 0.0))
    solver = ClothSolver(cloth, SolverOptions(tolerance=1e-6))
    result = solver.step(ClothState.flat(mesh), math.inf)
    assert result.status is Status.CONVERGED
    rest = simulate(solver, ClothState.flat(mesh), Schedule(0.0, 0.05, rest_tolerance=1e-5)).state
    np.testing.assert_allclose(result.state.positions, rest.positions, atol=1e-6)


def test_energy_never_grows_by_itself() -> None:
    mesh = rectangle(0.06, 0.06, 0.01)
    pin = strip("pin", mesh, np.arange(mesh.vertex_count) == mesh.nearest_vertex([-0.03, 0.03]))
    solver = ClothSolver(Cloth(mesh, fabric(), (pin,)), SolverOptions(tolerance=1e-6))
    totals, state = [], ClothState.flat(mesh)
    for _ in range(6):
        totals.append(sum(solver.energies(state).values()))
        state = solver.advance(state, 0.02).state
    assert all(b <= a + 1e-9 for a, b in itertools.pairwise(totals))


def test_a_failed_step_keeps_the_last_good_state() -> None:
    mesh = rectangle(0.06, 0.06, 0.01)
    side = strip("side", mesh, mesh.panel[:, 0] > 0.03 - 1e-9, Motion((0.05, 0.02, 0.03), 0.0, 0.01))
    options = SolverOptions(tolerance=1e-9, acceptable=1e-9, iterations=1, halvings=1)
    solver = ClothSolver(Cloth(mesh, fabric(), (side,)), options)
    start = ClothState.flat(mesh)
    run = simulate(solver, start, Schedule(0.1, 0.05))
    assert run.status is Status.ITERATION_LIMIT and not run.converged
    assert run.state is start
    assert run.newton_iterations == 2


def test_frames_come_as_they_finish_and_end_with_the_last_state() -> None:
    mesh = rectangle(0.04, 0.04, 0.01)
    solver = ClothSolver(Cloth(mesh, fabric()))
    times, numbers, shares = [], [], []
    run = simulate(
        solver,
        ClothState.flat(mesh),
        Schedule(0.1, 0.02, to_rest=False, frame_interval=0.04),
        on_frame=lambda number, state: (numbers.append(number), times.append(state.time)),
        on_step=lambda progress: shares.append(progress.share),
    )
    np.testing.assert_allclose(times, [0, 0.04, 0.08, 0.1])
    assert numbers == [0, 1, 2, 3]
    np.testing.assert_allclose(shares, [0.2, 0.4, 0.6, 0.8, 1.0])
    assert times[-1] == run.state.time


def test_motion_eases_in_and_out() -> None:
    motion = Motion((0.0, 2.0, 0.0), 1.0, 2.0)
    assert motion.offset(0.5)[1] == 0 and motion.offset(1.0)[1] == 0
    assert motion.offset(2.0)[1] == pytest.approx(1.0)
    assert motion.offset(3.0)[1] == motion.offset(9.0)[1] == 2.0
    assert motion.offset(1.01)[1] < 1e-3


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda m: Cloth(m, fabric(), damping=-1.0), "damping; expected zero or more"),
        (lambda m: Cloth(m, fabric(), gravity=(0.0, 0.0, math.nan)), "gravity; expected three finite"),
        (lambda m: Handle("bar", np.zeros(0, np.int64), np.zeros((0, 3))), "handle 'bar'; expected vertices"),
        (
            lambda m: Cloth(m, fabric(), (strip("bar", m, m.panel[:, 0] < 0),) * 2),
            "handles; expected names that differ; found 'bar' twice",
        ),
        (lambda m: Schedule(1.0, 0.0), "time_step; expected a positive number"),
        (lambda m: SolverOptions(tolerance=-1.0), "tolerance; expected between"),
        (
            lambda m: ClothSolver(Cloth(m, fabric())).step(ClothState.flat(m), 0.0),
            "time step; expected a positive",
        ),
    ],
)
def test_impossible_numbers_are_named(call, message: str) -> None:
    with pytest.raises(InputError, match=message):
        call(rectangle(0.04, 0.04, 0.01))

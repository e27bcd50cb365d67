"""Equilibria along a load: a strip that buckles as the elastica says, and a knit that wrinkles as it is stretched."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from yarnscale.errors import InputError
from yarnscale.files.material_json import read_material
from yarnscale.motion.body import Step
from yarnscale.motion.handles import Handle
from yarnscale.motion.quasi_static import equilibrium, follow_load
from yarnscale.motion.rigid import Motion
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import LoadSteps, Schedule
from yarnscale.numerics.newton import Status
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver, SolverOptions
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
from yarnscale.shell.mesh import TriangleMesh, rectangle
from yarnscale.shell.scenes.scene import central_stretch
from yarnscale.shell.state import ClothState

BEND, LENGTH, WIDTH = 2e-5, 0.08, 0.024


def strip_solver(spacing: float, shortening: float) -> ClothSolver:
    """A strip clamped along rows of triangles at both ends, which come closer by ``shortening`` [m] in 1 s."""
    material = OrthotropicMaterial(
        stretch_weft=400.0,
        stretch_coupling=0.0,
        stretch_warp=400.0,
        shear=100.0,
        bend_weft=BEND,
        bend_bias=BEND,
        bend_warp=BEND,
    )
    mesh = rectangle(LENGTH + 2 * spacing, WIDTH, spacing)
    return ClothSolver(
        Cloth(mesh, material, clamps(mesh, 0.5 * LENGTH, -0.5 * shortening), gravity=(0.0, 0.0, 0.0)),
        SolverOptions(tolerance=1e-4),
    )


def clamps(mesh: TriangleMesh, beyond: float, travel: float) -> tuple[Handle, ...]:
    flat, across = ClothState.flat(mesh).positions, mesh.panel[:, 0]
    handles = []
    for side in (-1.0, 1.0):
        vertices = np.flatnonzero(side * across > beyond - 1e-9)
        motion = Motion((side * travel, 0.0, 0.0), 0.0, 1.0)
        handles.append(Handle(f"side {side:g}", vertices, flat[vertices], motion))
    return tuple(handles)


def elastica_force(shortening: float) -> float:
    """Force [N] of a clamped strip whose ends came closer: four quarters of Euler's elastica, EI = 2·BEND per width.

    1 − e/L = 2 E(m)/K(m) − 1,  P = 4π² EI/L² (2 K(m)/π)².
    """
    m = brentq(lambda m: 2 * ellipe(m) / ellipk(m) - 2 + shortening / LENGTH, 1e-9, 0.9)
    return 16 * float(ellipk(m)) ** 2 * 2 * BEND / LENGTH**2 * WIDTH


def test_a_strip_buckles_and_pushes_as_the_elastica() -> None:
    shortening = 0.2 * LENGTH
    errors = []
    for spacing in (0.004, 0.002):
        solver = strip_solver(spacing, shortening)
        state, status = follow_load(solver, ClothState.flat(solver.cloth.mesh), 1.0)
        assert status is Status.CONVERGED and state.time == pytest.approx(1.0)
        force = solver.pull(solver.cloth.handles[0], state)
        assert abs(state.positions[:, 2]).max() > 0.25 * LENGTH
        errors.append(abs(force[0] / elastica_force(shortening) - 1))
    # The clamp holds the slope up to half a triangle beyond its last row: an error of first order.
    assert errors[1] < 0.05 and errors[1] < 0.62 * errors[0]


def test_flat_beyond_the_critical_load_is_no_equilibrium() -> None:
    """The first load is beyond Euler's, and nothing disturbs the strip: the solver must leave the saddle itself."""
    solver = strip_solver(0.004, 0.02 * LENGTH)
    flat = ClothState.flat(solver.cloth.mesh)
    result, _ = equilibrium(solver, flat, time=1.0)
    assert result.status is Status.CONVERGED
    squeezed = flat.positions * [1 - 0.02, 1.0, 1.0]
    assert solver.energy.value(result.state.positions) < 0.5 * solver.energy.value(squeezed)


def test_the_viscous_flow_finds_the_same_equilibrium() -> None:
    """A static solve that may not iterate always fails, so that the flow does the work."""
    solver = strip_solver(0.004, 0.1 * LENGTH)
    start = follow_load(solver, ClothState.flat(solver.cloth.mesh), 0.5)[0]
    direct, crept = equilibrium(solver, start, time=1.0)
    assert not crept
    flow, crept = equilibrium(solver, start, time=1.0, loads=LoadSteps(easy=0))
    assert crept and flow.status is Status.CONVERGED
    np.testing.assert_allclose(flow.state.positions, direct.state.positions, atol=1e-5)


def test_a_path_that_cannot_go_on_keeps_the_last_equilibrium() -> None:
    solver = strip_solver(0.008, 0.05 * LENGTH)
    impossible = ClothSolver(solver.cloth, SolverOptions(tolerance=1e-13, acceptable=1e-13, iterations=2))
    start = ClothState.flat(solver.cloth.mesh)
    reached: list[Step] = []
    loads = LoadSteps(smallest=0.06, easy=0, viscous_steps=2)
    state, status = follow_load(impossible, start, 1.0, loads=loads, on_equilibrium=reached.append)
    assert status is not Status.CONVERGED and state.time < 1.0
    assert state is (reached[-1].state if reached else start)


def test_stretched_stockinette_narrows_the_same_by_statics_and_by_dynamics(shared: Path) -> None:
    material = read_material(shared / "reference" / "stock1.json")
    mesh = rectangle(0.1, 0.1, 0.01)
    cloth = Cloth(mesh, material, clamps(mesh, 0.035, 0.01))
    solver = ClothSolver(cloth)
    heights: list[float] = []
    state, status = follow_load(
        solver, ClothState.flat(mesh), 1.0, on_equilibrium=lambda r: heights.append(float(r.state.time))
    )
    assert status is Status.CONVERGED and all(b > a for a, b in itertools.pairwise(heights))
    run = simulate(solver, ClothState.flat(mesh), Schedule(1.0, 0.1, rest_tolerance=1e-3))
    static, dynamic = (central_stretch(mesh, end.positions, 0.02) for end in (state, run.state))
    np.testing.assert_allclose(static, dynamic, rtol=0.01)
    assert static[0] > 1.2 and static[1] < 0.99


def test_impossible_loads_are_named() -> None:
    with pytest.raises(InputError, match="load steps"):
        LoadSteps(first=0.5, largest=0.2)
    with pytest.raises(InputError, match="duration; expected a positive number"):
        solver = strip_solver(0.008, 0.0)
        follow_load(solver, ClothState.flat(solver.cloth.mesh), math.inf)

"""Drag of the air: terminal speed, no drag within the surface, the matrix against a sum over vertices."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.shell.dynamics.air import drag_entries
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver, SolverOptions
from yarnscale.shell.elastic.energy import ShellEnergy
from yarnscale.shell.materials.orthotropic import JERSEY
from yarnscale.shell.mesh import rectangle
from yarnscale.shell.state import ClothState

CLOTH = replace(JERSEY, bend_weft=2e-4, bend_bias=2e-4, bend_warp=2e-4)
MESH = rectangle(0.06, 0.06, 0.02)


def fall(tilt: float, duration: float, *, drag: float = 10.0, time_step: float = 0.01) -> np.ndarray:
    """Mean velocity of a sheet that falls, turned about the x-axis by ``tilt``."""
    c, s = math.cos(tilt), math.sin(tilt)
    x, y = MESH.panel.T
    positions = np.column_stack([x, c * y, s * y])
    solver = ClothSolver(Cloth(MESH, CLOTH, air_drag=drag), SolverOptions(tolerance=1e-8))
    run = simulate(
        solver, ClothState(positions, np.zeros_like(positions)), Schedule(duration, time_step, to_rest=False)
    )
    assert run.converged
    return run.state.velocities.mean(axis=0)


def test_a_flat_sheet_falls_with_its_terminal_speed() -> None:
    """Weight per area = drag v²; on the way to it v = v∞ tanh(g t / v∞)."""
    terminal = math.sqrt(CLOTH.density * 9.81 / 10.0)
    assert fall(0.0, 0.4)[2] == pytest.approx(-terminal, rel=1e-3)
    early = [abs(fall(0.0, 0.04, time_step=h)[2]) - terminal * math.tanh(9.81 * 0.04 / terminal) for h in (0.01, 0.005)]
    # The product of the speeds before and after a step stands for their square: of second order while steps are equal.
    assert 3.6 < early[0] / early[1] < 4.4


def test_a_sheet_on_edge_falls_freely() -> None:
    np.testing.assert_allclose(fall(0.5 * math.pi, 0.1), [0.0, 0.0, -0.981], atol=1e-3)


def test_the_matrix_is_that_of_each_vertex() -> None:
    rng = np.random.default_rng(2)
    positions = MESH.assembled + 2e-3 * rng.standard_normal((MESH.vertex_count, 3))
    velocities = rng.standard_normal(positions.shape)
    pattern = ShellEnergy(MESH, CLOTH).pattern
    entries = drag_entries(MESH, pattern, positions, velocities, 10.0)
    force = pattern.multiply(entries, velocities.ravel()).reshape(-1, 3)
    expected = np.zeros_like(force)
    for vertex in range(MESH.vertex_count):
        area = np.zeros(3)
        for triangle in MESH.triangles[(MESH.triangles == vertex).any(axis=1)]:
            a, b, c = positions[triangle]
            area += np.cross(b - a, c - a) / 6.0
        normal = area / np.linalg.norm(area)
        speed = velocities[vertex] @ normal
        expected[vertex] = 10.0 * np.linalg.norm(area) * abs(speed) * speed * normal
    np.testing.assert_allclose(force, expected, atol=1e-12)


def test_bad_drag_is_told() -> None:
    with pytest.raises(InputError, match="air_drag; expected zero or more"):
        Cloth(MESH, CLOTH, air_drag=-1.0)

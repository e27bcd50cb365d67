"""Cloth with friction inside: forces of loading and unloading, and resumed runs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from yarnscale.files.checkpoint_file import CheckpointFile
from yarnscale.motion.handles import Handle
from yarnscale.motion.rigid import Motion
from yarnscale.motion.run import simulate
from yarnscale.motion.scene import run_scene
from yarnscale.motion.schedule import Schedule
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver, SolverOptions
from yarnscale.shell.elastic.energy import ShellEnergy
from yarnscale.shell.materials.compact import CompactMaterial, SpringNetwork, shapes_of
from yarnscale.shell.materials.friction import Sliders
from yarnscale.shell.materials.history import MaterialHistory
from yarnscale.shell.mesh import rectangle
from yarnscale.shell.scenes.sheet_scenes import bagging
from yarnscale.shell.state import ClothState

SCALE = np.array([0.5, 0.5, 0.5, 100.0, 100.0, 100.0])
LENGTH, WIDTH, PULL = 0.06, 0.03, 0.006


@pytest.fixture(scope="module")
def material() -> CompactMaterial:
    """10 N/m along the course, and a slider of 3/10 of the elastic stress."""
    none = SpringNetwork(*(np.zeros(tuple(shape)) for shape in shapes_of(1, 1, 1)))
    growth = 0.01 * np.eye(6)[:1]
    sliders = Sliders.checked(np.eye(6)[:1], np.zeros((1, 1)), np.array([30.0]), np.zeros(1), growth, growth)
    return CompactMaterial(0.0, SCALE, none._replace(background=np.full(6, 2.5)), density=0.2, sliders=sliders)


def strip(material: CompactMaterial) -> tuple[Cloth, ClothState]:
    """A strip whose end moves out within a second."""
    mesh = rectangle(LENGTH, WIDTH, 0.01)
    start, ends = ClothState.flat(mesh), []
    for name, side, pull in (("left", -1.0, 0.0), ("right", 1.0, PULL)):
        vertices = np.flatnonzero(side * mesh.panel[:, 0] > 0.5 * LENGTH - 1e-6)
        ends.append(Handle(name, vertices, start.positions[vertices], Motion((pull, 0.0, 0.0), 0.0, 1.0, ease=False)))
    return Cloth(mesh, material, tuple(ends), gravity=(0.0, 0.0, 0.0)), start


def test_a_strip_pulled_out_and_back_has_the_forces_of_its_material(material: CompactMaterial) -> None:
    cloth, state = strip(material)
    solver, right = ClothSolver(cloth, SolverOptions(tolerance=1e-5)), cloth.handles[1]
    history, lost = MaterialHistory.begin(material, np.zeros(6)), 0.0
    forces = []
    for time in [*np.linspace(0, 1, 9)[1:], *np.linspace(1, 0, 9)[1:]]:
        step = solver.step(state, math.inf, until=float(time))
        assert solver.keeps(step)
        state, history = step.state, history.after(np.array([PULL * time / LENGTH, 0, 0, 0, 0, 0]))
        lost += history.dissipated
        forces.append(float(solver.pull(right, state)[0]))
        assert forces[-1] == pytest.approx(WIDTH * history.force[0], abs=1e-3 * WIDTH)
        # With all that springs hold, although the next step's limits on the way back are lower.
        stored = solver.energies(state)["elastic"]
        assert stored == pytest.approx(LENGTH * WIDTH * history.stored, rel=1e-3)
    assert lost > 0.0 and forces[8] < 0.7 * forces[6] and forces[-1] < 0.0
    elastic = ClothSolver(strip(replace(material, sliders=None))[0])
    assert elastic.energy.remembered(state.positions) is None


def test_before_a_step_begins_the_energy_is_without_friction(material: CompactMaterial) -> None:
    mesh = rectangle(LENGTH, WIDTH, 0.01)
    pulled = ClothState.flat(mesh).positions * [1.1, 1.0, 1.0]
    energy, elastic = ShellEnergy(mesh, material), ShellEnergy(mesh, replace(material, sliders=None))
    assert energy.value(pulled) == pytest.approx(elastic.value(pulled), rel=1e-6)


def test_a_resumed_run_remembers(material: CompactMaterial, tmp_path) -> None:
    cloth, start = strip(material)
    schedule = Schedule(0.3, 0.05, to_rest=False, frame_interval=0.05)
    file = CheckpointFile(tmp_path / "checkpoint.npz", ClothState, {"cloth": "strip"}, interval=0.0)
    whole = simulate(ClothSolver(cloth), start, schedule)

    class Killed(Exception):
        pass

    def stop(run) -> None:
        file.write(run)
        if run.steps == 3:
            raise Killed

    with pytest.raises(Killed):
        simulate(ClothSolver(cloth), start, schedule, on_checkpoint=stop)
    resumed = simulate(ClothSolver(cloth), start, schedule, resume=file.read())
    assert whole.converged and whole.state.memory is not None
    np.testing.assert_array_equal(resumed.state.positions, whole.state.positions)
    np.testing.assert_array_equal(resumed.state.memory, whole.state.memory)


@pytest.mark.slow
def test_a_ball_leaves_a_bag_in_cloth_with_friction_alone(material: CompactMaterial) -> None:
    none = np.zeros((2, 6))
    both_ways = Sliders.checked(np.eye(6)[[0, 2]], np.zeros((2, 1)), [30.0, 30.0], [0.02, 0.02], none, none)

    def sag(of: CompactMaterial, depth: float) -> float:
        scene = bagging(of, size=0.06, spacing=0.012, depth=depth, duration=1.0)
        schedule = replace(scene.schedule, to_rest=True, frame_interval=None)
        result = run_scene(replace(scene, schedule=schedule))
        assert result.converged
        return result.measures["sag"]

    for sliders, least, most in ((both_ways, 0.5e-3, 0.01), (None, -2e-5, 2e-5)):
        of = replace(material, sliders=sliders)
        assert least < sag(of, 0.018) - sag(of, 0.0) < most

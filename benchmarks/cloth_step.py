"""Least milliseconds of the parts of one Newton iteration of cloth, and the cost of the published stretch test.

Run ``python benchmarks/cloth_step.py [MATERIAL.json] [--amount GAP] [--direction wale] [--scenes]``; without a file, a
woven orthotropic material. ``--amount`` is the growth of the gap between the bars (published: 0.373 stockinette,
0.213 satin). ``YARNSCALE_THREADS`` and ``OPENBLAS_NUM_THREADS`` set the threads.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Literal

import numpy as np

from yarnscale.files.material_json import read_material
from yarnscale.motion.scene import run_scene
from yarnscale.numerics.factor import Factorisation
from yarnscale.shell.contact.cloth_contact import ClothContact, ContactSettings
from yarnscale.shell.dynamics.solver import ClothSolver
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.materials.orthotropic import JERSEY, OrthotropicMaterial
from yarnscale.shell.scenes.scene import drape, stretch


def woven() -> OrthotropicMaterial:
    return replace(JERSEY, bend_bias=2e-6, bend_warp=2e-6)


def milliseconds(run: Callable[[], object], repeats: int = 7) -> float:
    run()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return 1e3 * min(times)


def iteration(material: ShellMaterial) -> None:
    """The parts of an iteration on a rolled sheet whose layers touch."""
    solver = ClothSolver(stretch(material).cloth)
    mesh, energy = solver.cloth.mesh, solver.energy
    turn, gap = 0.04, 7e-4
    angle = mesh.panel[:, 0] / turn
    radius = turn + gap * angle / (2 * np.pi)
    positions = np.column_stack([radius * np.sin(angle), mesh.panel[:, 1], radius * (1 - np.cos(angle))])
    energy.follow(positions)
    linear = energy.linearise(positions)
    matrix = linear.hessian("positive")
    matrix[energy.pattern.diagonal] += np.repeat(solver.masses / 0.05**2, 3)
    factor = Factorisation(energy.pattern)
    right = np.ones(energy.pattern.size)
    contact = ClothContact(mesh, ContactSettings())
    step = 1e-3 * np.random.default_rng(0).normal(size=positions.shape)
    parts: list[tuple[str, Callable[[], object]]] = [
        ("energy (a trial of the line search)", lambda: energy.value(positions)),
        ("energy, gradient, moduli", lambda: energy.linearise(positions, linear)),
        ("positive Hessian, assembled", lambda: linear.hessian("positive")),
        ("exact Hessian, assembled", lambda: linear.hessian("exact")),
        ("symbolic analysis (once per pattern)", lambda: Factorisation(energy.pattern)),
        ("factorisation", lambda: factor.factor(matrix)),
        ("solve", lambda: factor.solve(right)),
        ("self-contact: bound of a step", lambda: contact.bound(positions, step)),
        ("self-contact: energy and gradient", lambda: contact.gradient(positions)),
        ("self-contact: Hessian", lambda: contact.hessian(positions)),
    ]
    print(f"{mesh.vertex_count} vertices, {energy.pattern.entries} matrix entries")
    print(f"{'part of an iteration':44}{'ms':>8}")
    for name, run in parts:
        print(f"{name:44}{milliseconds(run):8.2f}")


def scenes(material: ShellMaterial) -> None:
    print(f"{'scene':24}{'steps':>7}{'iterations':>12}{'seconds':>9}  ended")
    for scene in (stretch(material), stretch(material, direction="wale"), drape(material)):
        result = run_scene(scene)
        cost = f"{result.run.steps:7}{result.run.newton_iterations:12}{result.seconds:9.1f}"
        print(f"{scene.name:24}{cost}  {result.run.outcome}", flush=True)


class Stopwatch:
    """Seconds and calls by name; time in a nested call counts for that call only."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.calls: dict[str, int] = defaultdict(int)
        self._inner = [0.0]

    @contextmanager
    def running(self, name: str) -> Iterator[None]:
        begin = time.perf_counter()
        self._inner.append(0.0)
        try:
            yield
        finally:
            spent = time.perf_counter() - begin
            self.seconds[name] += spent - self._inner.pop()
            self.calls[name] += 1
            self._inner[-1] += spent

    def watch(self, owner: object, method: str, name: str) -> None:
        """Time every call of a method of one object."""
        original = getattr(owner, method)

        def timed(*arguments: object, **options: object) -> object:
            with self.running(name):
                return original(*arguments, **options)

        setattr(owner, method, timed)


def stretching(
    material: ShellMaterial,
    *,
    amount: float,
    direction: Literal["course", "wale"],
    time_step: float,
    rough: int | None,
    self_contact: bool,
) -> None:
    """Cost of the dynamics of the stretch test per 1/30 s simulated, and where the time goes."""
    scene = stretch(material, amount=amount, direction=direction, time_step=time_step, self_contact=self_contact)
    solver, state, watch = ClothSolver(scene.cloth, scene.options), scene.start, Stopwatch()
    solver.step(state, time_step, iterations=1)  # compile
    for method, name in (
        ("value", "energy"),
        ("linearise", "energy, gradient, moduli"),
        ("positive_hessian", "positive Hessian"),
        ("exact_hessian", "exact Hessian"),
        ("follow", "fold angles"),
    ):
        watch.watch(solver.energy, method, name)
    watch.watch(solver.linear, "factorise", "factorisation, with assembly of the matrix")
    watch.watch(solver.linear, "step", "solve")
    for method in ("bound", "value", "gradient", "hessian"):
        watch.watch(solver.contact, method, f"contact: {method}")
    solver.linear.factorisations = solver.linear.analyses = 0
    duration = scene.schedule.duration
    frames, steps, iterations, worst = 30 * duration, round(duration / time_step), 0, 0.0
    begin, begin_cpu = time.perf_counter(), time.process_time()
    with watch.running("the rest: line search, recursion, sums"):
        for _ in range(steps):
            result = solver.advance(state, duration / steps, iterations=rough, unfinished=rough is not None)
            state, iterations = result.state, iterations + result.iterations
            worst = max(worst, result.residual)
    wall, cpu = time.perf_counter() - begin, time.process_time() - begin_cpu
    title = "every step converged" if rough is None else f"{rough} iterations a step"
    touching = "self-contact" if self_contact else "no contact"
    print(f"\nstretch {direction}, {title}, {touching}, steps of 1/{1 / time_step:.0f} s")
    print(f"  per 1/30 s simulated: {wall / frames:.2f} s wall, {cpu / frames:.2f} s processor")
    print(f"  {steps} steps, {iterations} iterations, worst residual {worst:.1e}")
    print(f"  {solver.linear.factorisations} factorisations, {solver.linear.analyses} symbolic analyses")
    for name, seconds in sorted(watch.seconds.items(), key=lambda item: -item[1]):
        calls = watch.calls[name]
        print(f"  {name:44}{calls / frames:8.1f} calls{1e3 * seconds / frames:9.1f} ms")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("material", nargs="?")
    parser.add_argument("--amount", type=float, default=0.213)
    parser.add_argument("--direction", choices=["course", "wale"], default="course")
    parser.add_argument("--steps", type=float, nargs="*", default=[30.0, 60.0], help="per second")
    parser.add_argument("--scenes", action="store_true", help="the built-in scenes as a whole too")
    arguments = parser.parse_args()
    material = read_material(arguments.material) if arguments.material else woven()
    iteration(material)
    for rate in arguments.steps:
        # The work of the animation setting goes with the steps: as much per frame.
        for rough, touching in ((None, False), (round(600 / rate), False), (None, True)):
            stretching(
                material,
                amount=arguments.amount,
                direction=arguments.direction,
                time_step=1 / rate,
                rough=rough,
                self_contact=touching,
            )
    if arguments.scenes:
        scenes(material)


if __name__ == "__main__":
    main()

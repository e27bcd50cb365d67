"""Least milliseconds of the parts of one Newton iteration of cloth, and the cost of the built-in scenes.

Run ``python benchmarks/cloth_step.py [MATERIAL.json] [--scenes]``; without a file, a woven orthotropic material.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

from yarnscale.files.material_json import read_material
from yarnscale.numerics.factor import factorisation
from yarnscale.shell.contact import ClothContact, ContactSettings
from yarnscale.shell.material import ShellMaterial
from yarnscale.shell.orthotropic import OrthotropicMaterial
from yarnscale.shell.scene import drape, run_scene, stretch
from yarnscale.shell.simulate import ClothSolver


def woven() -> OrthotropicMaterial:
    return OrthotropicMaterial(
        stretch_weft=60.0,
        stretch_coupling=10.0,
        stretch_warp=90.0,
        shear=20.0,
        area=2.0,
        log_area=2.0,
        bend_weft=2e-6,
        bend_bias=2e-6,
        bend_warp=2e-6,
        density=0.2,
    )


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
    factor = factorisation(energy.pattern)
    right = np.ones(energy.pattern.size)
    contact = ClothContact(mesh, ContactSettings())
    step = 1e-3 * np.random.default_rng(0).normal(size=positions.shape)
    parts: list[tuple[str, Callable[[], object]]] = [
        ("energy (a trial of the line search)", lambda: energy.value(positions)),
        ("energy, gradient, moduli", lambda: energy.linearise(positions, linear)),
        ("positive Hessian, assembled", lambda: linear.hessian("positive")),
        ("exact Hessian, assembled", lambda: linear.hessian("exact")),
        ("symbolic analysis (once per pattern)", lambda: factorisation(energy.pattern)),
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
        cost = f"{result.steps:7}{result.newton_iterations:12}{result.seconds:9.1f}"
        print(f"{scene.name:24}{cost}  {result.status.value}", flush=True)


def main() -> None:
    paths = [word for word in sys.argv[1:] if not word.startswith("--")]
    material = read_material(paths[0]) if paths else woven()
    iteration(material)
    if "--scenes" in sys.argv:
        scenes(material)


if __name__ == "__main__":
    main()

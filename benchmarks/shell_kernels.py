"""Microseconds of processor time per triangle for the parts of a cloth Hessian, one thread.

Run ``python benchmarks/shell_kernels.py [MATERIAL.json]``; without a file, the random spline material of
``material_kernels`` is used. The sheet has 2612 vertices and is crumpled, so that many moduli are indefinite. The
full 18×18 eigenvalue projection (numpy, which HYLC20 uses) and, where installed, JAX's ``vmap(hessian)`` of the
fundamental forms are measured for comparison.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np
from material_kernels import random_spline_material

from yarnscale.files.material_json import read_material
from yarnscale.numerics.kernel import BLOCK
from yarnscale.shell.elastic.element_loops import (
    element_hessian,
    forms_of_blocks,
    gradient_of_blocks,
    scatter_hessian,
)
from yarnscale.shell.elastic.energy import ShellEnergy
from yarnscale.shell.elastic.moduli import positive_moduli
from yarnscale.shell.elastic.strain import form_kernels
from yarnscale.shell.mesh import rectangle


def seconds(run: Callable[[], object], repeats: int = 15) -> float:
    run()
    times = []
    for _ in range(repeats):
        start = time.thread_time()
        run()
        times.append(time.thread_time() - start)
    return float(np.median(times))


def crumpled_sheet(path: str | None) -> tuple[ShellEnergy, np.ndarray]:
    mesh = rectangle(0.3, 0.3, 0.0065)
    energy = ShellEnergy(mesh, read_material(path) if path else random_spline_material())
    x, y = mesh.panel.T
    rng = np.random.default_rng(0)
    heights = 0.008 * np.sin(60 * x) * np.cos(45 * y) + 2e-4 * rng.normal(size=len(x))
    positions = np.column_stack([mesh.panel * [1.1, 0.95], heights])
    energy.follow(positions)
    return energy, positions


def rows(energy: ShellEnergy, positions: np.ndarray) -> list[tuple[str, float]]:
    elements, kernels = energy.elements, form_kernels()
    shape, nothing = (elements.blocks, 6, BLOCK), np.empty((0, 0, 0))
    forms, linear = np.empty(shape), energy.linearise(positions)
    full, work, element = np.empty((36, BLOCK)), np.empty((108, BLOCK)), np.empty((171, BLOCK))
    values, gradient = np.zeros(energy.pattern.entries + 1), np.zeros_like(positions)
    blocks = range(elements.blocks)
    where = (positions, elements.stencils, elements.geometry)
    j, s, a = linear.jacobian, linear.stress, elements.areas
    parts: list[tuple[str, Callable[[], object]]] = [
        ("fundamental forms", lambda: forms_of_blocks(*where, kernels.value.address, nothing, forms)),
        ("fundamental forms and Jacobian", lambda: forms_of_blocks(*where, kernels.jacobian.address, j, forms)),
        ("gradient from stress, scattered", lambda: gradient_of_blocks(j, s, a, elements.stencils, gradient)),
        ("6×6 moduli made positive", lambda: [positive_moduli(linear.moduli[b], full) for b in blocks]),
        ("JᵀCJ", lambda: [element_hessian(j[b], full, a[b], work, element) for b in blocks]),
        ("scatter into the matrix", lambda: [scatter_hessian(element, energy._slots[b], values) for b in blocks]),
        ("reference angles follow", lambda: energy.follow(positions)),
        ("energy, with material", lambda: energy.value(positions)),
        ("energy, gradient, moduli", lambda: energy.linearise(positions, linear)),
        ("positive Hessian, assembled", lambda: linear.hessian("positive")),
        ("exact Hessian, assembled", lambda: linear.hessian("exact")),
        ("all of a step: energy to positive Hessian",
         lambda: energy.linearise(positions, linear).hessian("positive")),
    ]  # fmt: skip
    count = elements.blocks * BLOCK
    return [(name, 1e6 * seconds(run) / count) for name, run in parts]


def full_projection(energy: ShellEnergy, positions: np.ndarray) -> float:
    """Eigenvalue projection of random symmetric 18×18 matrices, microseconds each."""
    matrices = np.random.default_rng(0).normal(size=(512, 18, 18))
    matrices = matrices + matrices.transpose(0, 2, 1)

    def project() -> np.ndarray:
        values, vectors = np.linalg.eigh(matrices)
        return np.einsum("nij,nj,nkj->nik", vectors, np.maximum(values, 0), vectors, optimize=True)

    return 1e6 * seconds(project, 5) / len(matrices)


def jax_hessian(energy: ShellEnergy, positions: np.ndarray) -> float | None:
    """``vmap(hessian)`` of Σ stress·(I, II), microseconds each; None where JAX is not installed."""
    try:
        import jax
        import jax.numpy as jnp
    except ImportError:
        return None
    jax.config.update("jax_enable_x64", True)

    def contracted(x, inverse, stress):  # type: ignore[no-untyped-def]
        x = x.reshape(6, 3)
        gradient = jnp.stack([x[1] - x[0], x[2] - x[0]], axis=1) @ inverse
        normal = jnp.cross(x[1] - x[0], x[2] - x[0])
        double_area = jnp.linalg.norm(normal)
        normal, shape = normal / double_area, jnp.zeros((3, 3))
        for k in range(3):
            edge = x[(k + 1) % 3] - x[k]
            length, other = jnp.linalg.norm(edge), jnp.cross(x[3 + k] - x[k], edge)
            other = other / jnp.linalg.norm(other)
            angle = jnp.arctan2(jnp.dot(jnp.cross(normal, other), edge) / length, jnp.dot(normal, other))
            across = jnp.cross(edge, normal)
            shape = shape - angle / (double_area * length) * jnp.outer(across, across)
        first, second = gradient.T @ gradient, gradient.T @ shape @ gradient
        forms = jnp.array([first[0, 0], first[0, 1], first[1, 1], second[0, 0], second[0, 1], second[1, 1]])
        return stress @ forms

    mesh = energy.mesh
    inner = mesh.has_neighbour.all(axis=1)
    corners = jnp.array(positions[mesh.stencils[inner]].reshape(-1, 18))
    inverse, stress = jnp.array(mesh.inverse_rest[inner]), jnp.ones((int(inner.sum()), 6))
    run = jax.jit(jax.vmap(jax.hessian(contracted)))
    return 1e6 * seconds(lambda: run(corners, inverse, stress).block_until_ready(), 5) / len(corners)


def main() -> None:
    energy, positions = crumpled_sheet(sys.argv[1] if len(sys.argv) > 1 else None)
    _, indefinite = energy.positive_hessian(energy.linearise(positions))
    print(f"{len(energy.mesh.triangles)} triangles, {indefinite} of them with indefinite moduli")
    print(f"{'part':44}{'µs per element':>16}")
    for name, time_each in rows(energy, positions):
        print(f"{name:44}{time_each:16.2f}")
    print(f"{'18×18 eigenvalue projection alone (numpy)':44}{full_projection(energy, positions):16.2f}")
    other = jax_hessian(energy, positions)
    text = "JAX not installed" if other is None else f"{other:.2f}"
    print(f"{'Σ stress·∇²(I, II) by JAX vmap(hessian)':44}{text:>16}")


if __name__ == "__main__":
    main()

"""Microseconds per element of a shell material: gather, energy, energy with gradient and second derivative.

Run ``python benchmarks/material_kernels.py [MATERIAL.json]``; without a file, an orthotropic and random
compact and spline materials are measured on a field of strains as cloth has them (neighbours alike). One thread.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

from yarnscale.files.material_json import read_material
from yarnscale.homogenize.compact_problem import CompactOptions
from yarnscale.numerics.kernel import BLOCK
from yarnscale.shell.materials.compact import CompactMaterial, SpringNetwork, shapes_of
from yarnscale.shell.materials.material import ShellMaterial, forms_of_strains
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
from yarnscale.shell.materials.spline_material import SplineMaterial
from yarnscale.shell.materials.spline_patches import PLANES
from yarnscale.shell.materials.tables import BicubicSpline, CubicSpline

ELEMENTS = 41 * BLOCK


def random_spline_material() -> SplineMaterial:
    """As many knots as a fit has: 15 an axis in one-dimensional terms, 9 in two-dimensional ones."""
    rng, reach = np.random.default_rng(0), np.array([0.8, 0.7, 0.8, 100.0, 100.0])
    line, plane = np.linspace(-1, 1, 15), np.linspace(-1, 1, 9)
    axes = tuple(CubicSpline(line * s, rng.normal(size=15), rng.normal(size=15)) for s in reach)
    planes = {(i, j): BicubicSpline(plane * reach[i], plane * reach[j], *rng.normal(size=(4, 9, 9))) for i, j in PLANES}
    return SplineMaterial(0.0, axes, planes, density=0.2)


def random_compact_material() -> CompactMaterial:
    """As many units as a fit has."""
    rng, scale = np.random.default_rng(0), np.array([0.5, 0.5, 0.5, 100.0, 100.0, 100.0])
    options = CompactOptions()
    arrays = SpringNetwork(*(rng.normal(size=tuple(shape)) for shape in shapes_of(options.steps, options.springs, 12)))
    positive = {n: np.abs(getattr(arrays, n)) for n in ("stiffnesses", "background", "wall_stiffnesses")}
    return CompactMaterial(0.0, scale, arrays._replace(**positive), density=0.2)


def cloth_like_strains(count: int) -> np.ndarray:
    """A smooth field with a little noise."""
    rng = np.random.default_rng(1)
    phase = np.linspace(0, 6 * np.pi, count)[:, None] * np.array([1.0, 1.3, 0.7, 2.1, 3.2, 1.7])
    return np.sin(phase) * [0.3, 0.3, 0.3, 60, 25, 60] + rng.normal(size=(count, 6)) * [
        0.01,
        0.01,
        0.01,
        5,
        2,
        5,
    ]


def seconds(run: Callable[[], None], repeats: int = 30) -> float:
    run()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def measure(material: ShellMaterial) -> tuple[float, float, float]:
    """µs per element of gather, value, value+gradient+Hessian, block by block as the cloth solver works."""
    forms = forms_of_strains(cloth_like_strains(ELEMENTS)).T
    blocks = [np.ascontiguousarray(forms[:, k : k + BLOCK]) for k in range(0, ELEMENTS, BLOCK)]
    parameters = [np.ascontiguousarray(material.parameters(blocks[0]))]
    psi, gradient, lower = np.zeros((1, BLOCK)), np.zeros((6, BLOCK)), np.zeros((21, BLOCK))
    kernels = material.kernels()

    def gather() -> None:
        for block in blocks:
            material.parameters(block)

    def value() -> None:
        for block in blocks:
            kernels.value(BLOCK, BLOCK, block, parameters[0], psi)

    def second() -> None:
        for block in blocks:
            kernels.second(BLOCK, BLOCK, block, parameters[0], psi, gradient, lower)

    scale = 1e6 / ELEMENTS
    return scale * seconds(gather), scale * seconds(value), scale * seconds(second)


def main() -> None:
    materials: dict[str, ShellMaterial]
    if len(sys.argv) > 1:
        materials = {name: read_material(name) for name in sys.argv[1:]}
    else:
        materials = {
            "compact": random_compact_material(),
            "spline": random_spline_material(),
            "orthotropic": OrthotropicMaterial(
                30.0, 10.0, 30.0, 5.0, 1.0, 0.1, bend_weft=1e-6, bend_bias=1e-6, bend_warp=1e-6
            ),
        }
    print(f"{'µs per element':28s} {'gather':>8s} {'value':>8s} {'value+gradient+Hessian':>24s}")
    for name, material in materials.items():
        gather, value, second = measure(material)
        print(f"{name[-28:]:28s} {gather:8.3f} {value:8.3f} {second:24.3f}")


if __name__ == "__main__":
    main()

"""Steps of a small cloth from random small deformations and from extreme ones: what became of each.

Run ``python benchmarks/cloth_robustness.py [MATERIAL.json ...] [--small N] [--extreme N]``; without files, a woven
orthotropic material. A step of 1/60 s must end with finite positions and a clear status, and every factorisation of
the positive model must succeed.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from cloth_step import woven
from numpy.typing import NDArray

from yarnscale.files.material_json import read_material
from yarnscale.numerics.kkt import ConstrainedSolver, QuadraticModel
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.mesh import rectangle
from yarnscale.shell.state import ClothState

Floats = NDArray[np.float64]
STEP = 1 / 60


def stretched(flat: Floats, rng: np.random.Generator) -> Floats:
    return flat * rng.uniform(2.0, 8.0, 3)


def crushed(flat: Floats, rng: np.random.Generator) -> Floats:
    """All of it in a ball a hundredth of its size."""
    return 0.01 * flat + rng.normal(scale=1e-4, size=flat.shape)


def inverted(flat: Floats, rng: np.random.Generator) -> Floats:
    """Some vertices on the other side of their neighbours: triangles turned over in their plane."""
    places = flat.copy()
    chosen = rng.random(len(flat)) < 0.3
    places[chosen, :2] += rng.normal(scale=0.02, size=(int(chosen.sum()), 2))
    return places


def folded(flat: Floats, rng: np.random.Generator) -> Floats:
    """One half laid on the other, exactly or with a hair between, about a line across triangles."""
    angle, offset = rng.uniform(0, np.pi), rng.uniform(-0.01, 0.01)
    normal = np.array([np.cos(angle), np.sin(angle)])
    height = flat[:, :2] @ normal - offset
    places = flat.copy()
    places[:, :2] -= 2 * np.maximum(height, 0.0)[:, None] * normal
    places[:, 2] = np.where(height > 0, rng.choice([0.0, 1e-6, 1e-4]), 0.0)
    return places


def collapsed(flat: Floats, rng: np.random.Generator) -> Floats:
    """On a line, or nearly: triangles without area."""
    return flat * [1.0, rng.choice([0.0, 1e-12, 1e-6]), 1.0]


def scattered(flat: Floats, rng: np.random.Generator) -> Floats:
    return rng.uniform(-0.05, 0.05, flat.shape)


EXTREMES = (stretched, crushed, inverted, folded, collapsed, scattered)


def slightly(flat: Floats, rng: np.random.Generator) -> Floats:
    """Noise from a micrometre to a fifth of an edge."""
    return flat + rng.normal(size=flat.shape) * 10.0 ** rng.uniform(-6, -2.7)


class CountingSolver(ConstrainedSolver):
    """Counts factorisations of the positive model, and those of them that failed."""

    positive = 0
    failed = 0

    def factorise(self, model: QuadraticModel, shift: float) -> bool:
        good = super().factorise(model, shift)
        if shift >= 1.0:
            self.positive += 1
            self.failed += not good
        return good


def outcomes(material: ShellMaterial, states: Iterator[Floats]) -> tuple[Counter[str], CountingSolver]:
    """How steps from these positions ended, by status, and the factorisations that they took."""
    solver = ClothSolver(Cloth(rectangle(0.06, 0.05, 0.01), material))
    solver.linear = counting = CountingSolver()
    found: Counter[str] = Counter()
    for positions in states:
        result = solver.step(ClothState(positions, np.zeros_like(positions)), STEP)
        sound = np.isfinite(result.state.positions).all() and np.isfinite(result.state.velocities).all()
        found[result.status.value if sound else "NaN"] += 1
    return found, counting


def states(kinds: tuple[Callable[[Floats, np.random.Generator], Floats], ...], count: int) -> Iterator[Floats]:
    flat = ClothState.flat(rectangle(0.06, 0.05, 0.01)).positions
    rng = np.random.default_rng(1)
    return (kinds[k % len(kinds)](flat, rng) for k in range(count))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("materials", nargs="*", type=Path)
    parser.add_argument("--small", type=int, default=10_000)
    parser.add_argument("--extreme", type=int, default=100)
    arguments = parser.parse_args()
    materials = {path.stem: read_material(path) for path in arguments.materials} or {"woven": woven()}
    for name, material in materials.items():
        rows = [("small", (slightly,), arguments.small)]
        rows += [(kind.__name__, (kind,), arguments.extreme) for kind in EXTREMES]
        for label, kinds, count in rows:
            begin = time.perf_counter()
            found, counting = outcomes(material, states(kinds, count))
            endings = ", ".join(f"{status} {number}" for status, number in found.most_common())
            factors = f"{counting.positive} factors, {counting.failed} failed"
            print(f"{name:12}{label:10}{count:6}  {factors:30}{time.perf_counter() - begin:7.1f} s  {endings}")


if __name__ == "__main__":
    main()

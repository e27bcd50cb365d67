"""Fit the sliders of a shell material to paths of its cell with friction.

They are to give the stress with friction less that without, over scaled strains, relative to the elastic stress of each
state. The trace of a slider depends on its own numbers alone, so that the Jacobian costs as much as few traces. Every
slider has its mirror image where the material is symmetric.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.homogenize.friction_paths import COUNT, FrictionPath
from yarnscale.shell.materials.compact import MIRROR, CompactMaterial
from yarnscale.shell.materials.friction import LEAST_LIMIT, ROUNDING, Sliders

STARTS, FIRST, LAST = 3, 25, 100
"""Starts of the search, evaluations of each, and further ones of the best."""
FLOOR = 0.1
"""Elastic stress over scaled strains that counts as large [J/m²]: 0.2 N/m."""
_AT_REST = 0.3
"""Weight of stresses whose strains hardly move in a path."""
_SMALLNESS = 1e-3
"""Weight of the numbers themselves, so that sliders that nothing moves fade away."""
_GUESS, _NARROW, _WIDE = 0.5, 1e-3, 5e-2
"""Start: limits over elastic stresses, and the slips per elastic stress at which sliders move [m²/J]."""
_FEWEST = 30
_LEAST = 1e-3
"""Weighted friction of a path that counts as none: equilibria are not more exact."""


@dataclass(frozen=True, eq=False)
class _Trace:
    """A path over scaled strains: steps (n − 1, 6), elastic stresses (n, 6), stress of friction and weights (n, 6)."""

    steps: Array
    pressures: Array
    wanted: Array
    weights: Array


def with_friction(
    material: CompactMaterial, paths: Sequence[FrictionPath], friction: float, seed: int = 0
) -> CompactMaterial:
    """The elastic material with sliders fitted to paths of its cell; friction: of the yarns, for the record.

    Raises InputError where the cell could follow hardly any path.
    """
    walked = [path for path in paths if len(path.strains) > 1]
    traces = [_trace(material, path) for path in walked]
    states = sum(len(trace.wanted) - 1 for trace in traces)
    if states < _FEWEST:
        raise InputError(
            "paths with friction", expected=f"at least {_FEWEST} states that the cell reaches", found=states
        )
    images = (np.ones(6), MIRROR) if material.mirrored else (np.ones(6),)
    problem, rng = _Problem(traces, images), np.random.default_rng(seed)
    best = min((problem.search(_start(rng), FIRST) for _ in range(STARTS)), key=problem.error)
    best = problem.search(best, LAST)
    record = {
        "coefficient": friction,
        "states": states,
        "error": problem.error(best),
        "errors": {p.name: _Problem([t], images).error(best) for p, t in zip(walked, traces, strict=True)},
        "unfinished": [path.name for path in paths if not path.complete],
    }
    return replace(
        material, sliders=problem.sliders(best), provenance={**material.provenance, "friction": record}
    )  # fmt: skip


def _trace(material: CompactMaterial, path: FrictionPath) -> _Trace:
    known = np.isfinite(path.elastic).all(axis=1, keepdims=True)
    fitted = material.stress(path.strains)
    elastic = np.where(known, path.elastic, fitted) * material.scale
    wanted = path.stresses * material.scale - elastic
    steps = np.diff(path.strains / material.scale, axis=0)
    size = np.linalg.norm(elastic, axis=1) + np.linalg.norm(wanted + elastic, axis=1) + FLOOR
    # Every path counts alike, and of its stresses most those that do its work.
    moved = np.linalg.norm(steps, axis=0)
    weights = (_AT_REST + moved / max(float(moved.max()), 1e-300)) / size[:, None]
    weights /= max(float(np.linalg.norm(weights * wanted)), _LEAST)
    # Limits grow with the elastic stresses that the cloth will have.
    return _Trace(steps, np.abs(fitted * material.scale), wanted, weights)


def _start(rng: np.random.Generator) -> Array:
    """Unknowns (COUNT, 12) of random directions, from sliders that move at once to ones that hardly do."""
    directions = rng.normal(size=(COUNT, 6))
    slips = np.geomspace(_NARROW, _WIDE, COUNT)
    roots = np.sqrt(_GUESS / slips / COUNT)
    directions *= (roots / np.linalg.norm(directions, axis=1))[:, None]
    growth = np.sqrt(slips * roots / np.sqrt(6.0))[:, None] * np.ones((1, 6))
    return np.concatenate([directions, growth], axis=1)


class _Problem:
    """Unknowns of each slider: √c a (6) and the roots (6) of the growth of √c y."""

    def __init__(self, traces: Sequence[_Trace], images: Sequence[Array]) -> None:
        self.traces, self.images = traces, images
        self.wanted = np.concatenate([(t.wanted * t.weights)[1:].ravel() for t in traces])

    def search(self, start: Array, evaluations: int) -> Array:
        """Better unknowns (COUNT, 12) than those of a start."""
        options = {"method": "lm", "max_nfev": evaluations}
        found = least_squares(self._residuals, start.ravel(), self._jacobian, **options)  # type: ignore[arg-type]
        return found.x.reshape(start.shape)

    def error(self, unknowns: Array) -> float:
        """Norm of what is not met over that of all friction, both relative to elastic stresses."""
        missed = self._evaluated(unknowns)[0] - self.wanted
        return float(np.linalg.norm(missed) / max(np.linalg.norm(self.wanted), _LEAST))

    def sliders(self, unknowns: Array) -> Sliders:
        """Sliders and their mirror images."""
        roots = np.maximum(np.linalg.norm(unknowns[:, :6], axis=1), 1e-9)  # those that faded away are zero
        count = len(self.images)
        directions = np.concatenate([image * unknowns[:, :6] / roots[:, None] for image in self.images])
        growth = unknowns[:, 6:] ** 2 / roots[:, None]
        return Sliders.checked(directions, np.tile(roots**2 / count, count), np.tile(growth, (count, 1)))

    def _residuals(self, flat: Array) -> Array:
        return np.concatenate([self._evaluated(flat)[0] - self.wanted, _SMALLNESS * flat])

    def _jacobian(self, flat: Array) -> Array:
        return np.concatenate([self._evaluated(flat)[1], _SMALLNESS * np.eye(flat.size)])

    def _evaluated(self, flat: Array) -> tuple[Array, Array]:
        """Weighted stresses of friction and their derivatives by the unknowns."""
        unknowns = flat.reshape(-1, 12)
        values, slopes = [], []
        for trace in self.traces:
            n = len(trace.wanted)
            stress, by = np.zeros((n, 6)), np.zeros((n, 6, len(unknowns), 12))
            for k, numbers in enumerate(unknowns):
                for image in self.images:
                    direction, share = image * numbers[:6], 1.0 / len(self.images)
                    pull, slope = _pulled(trace.steps, trace.pressures, direction, numbers[6:])
                    slope[:, :6] *= image
                    stress += share * pull[:, None] * direction
                    by[:, :, k] += share * direction[:, None] * slope[:, None]
                    by[:, range(6), k, range(6)] += share * pull[:, None] * image
            values.append((stress * trace.weights)[1:].ravel())
            slopes.append((by * trace.weights[:, :, None, None])[1:].reshape(-1, flat.size))
        return np.concatenate(values), np.concatenate(slopes)


@numba.njit(cache=True, error_model="numpy")
def _pulled(steps: NDArray, pressures: NDArray, direction: NDArray, roots: NDArray) -> tuple[NDArray, NDArray]:
    """Extension of a spring along a path (n,) and its derivatives (n, 12), see ``shell.materials.friction``."""
    n = len(pressures)
    pull, slope = np.zeros(n), np.zeros((n, 12))
    for i in range(1, n):
        u, y = pull[i - 1], LEAST_LIMIT
        for j in range(6):
            u += direction[j] * steps[i - 1, j]
            y += roots[j] * roots[j] * pressures[i - 1, j]
        sign, width = 1.0 if u >= 0.0 else -1.0, 2.0 * ROUNDING * y
        over = abs(u) - (1.0 - ROUNDING) * y
        share, beyond = min(max(over / width, 0.0), 1.0), max(over - width, 0.0)
        pull[i] = u - sign * (0.5 * width * share * share + beyond)
        by_limit = 0.0
        if share >= 1.0:
            by_limit = sign
        elif share > 0.0:
            by_limit = sign * share * (1.0 - ROUNDING + ROUNDING * share)
        for j in range(6):
            slope[i, j] = (1.0 - share) * (slope[i - 1, j] + steps[i - 1, j])
            slope[i, 6 + j] = (1.0 - share) * slope[i - 1, 6 + j] + 2.0 * by_limit * roots[j] * pressures[i - 1, j]
    return pull, slope

"""Fit the sliders of a shell material to paths of its cell with friction.

They are to give the stress with friction less that without, over scaled strains, relative to the elastic stress of each
state, and the work of it between two turns. The trace of a slider depends on its own numbers alone, so that the
Jacobian costs as much as few traces. Every slider has its mirror image where the material is symmetric.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.homogenize.friction_paths import COUNT, STEPS, FrictionPath
from yarnscale.shell.materials.compact import CompactMaterial, images_of
from yarnscale.shell.materials.friction import LEAST_LIMIT, ROUNDING, Sliders

STARTS, FIRST, LAST = 3, 40, 150
"""Starts of the search, evaluations of each, and further ones of the best. Six starts took 50 s, three 28 s; of
three fabrics one was fitted better by six, with an error of 0.297 in place of 0.311."""
FLOOR = 0.1
"""Elastic stress over scaled strains that counts as large [J/m²]: 0.2 N/m."""
_AT_REST = 0.3
"""Weight of stresses whose strains hardly move in a path."""
_OF_WORK = 1.0
"""Weight of the works between turns of a path."""
_CLOSED, _LEAST_LOOP = 0.5, 0.05
"""Two legs are a loop if they end nearer to their start than this share of the first; least area, of the work on it."""
_SMALLNESS = 1e-3
"""Weight of the numbers themselves, so that sliders that nothing moves fade away."""
_GUESS, _NARROW, _WIDE = 0.5, 1e-3, 5e-2
"""Start: limits over elastic stresses, and the slips per elastic stress at which sliders move [m²/J]."""
_AT_REST_LIMIT = 0.05
FEWEST = 30
_LEAST = 1e-3
"""Weighted friction of a path that counts as none: equilibria are not more exact."""


@dataclass(frozen=True, eq=False)
class _Trace:
    """A path over scaled strains.

    features: of each image (I, n, 6 + R), the scaled strains and the steps of the energy, and their derivatives
    (I, n, 6 + R, 6) by the strains; pressures: of each image, for springs that are pulled and pushed (I, 2, n, 13), one
    and the elastic stresses along them and against them; stress of friction and weights (n, 6); works: matrices
    (legs, n, 6) that give weighted work of a stress.
    """

    features: Array
    slopes: Array
    pressures: Array
    wanted: Array
    weights: Array
    works: Array


def with_friction(material: CompactMaterial, paths: Sequence[FrictionPath], friction: float) -> CompactMaterial:
    """The elastic material with sliders fitted to paths of its cell; friction: of the yarns, for the record.

    Raises InputError where the cell could follow hardly any path.
    """
    walked = [path for path in paths if len(path.strains) > 1]
    traces = [_trace(material, path) for path in walked]
    states = sum(len(trace.wanted) - 1 for trace in traces)
    if states < FEWEST:
        raise InputError(
            "paths with friction", expected=f"at least {FEWEST} states that the cell reaches", found=states
        )
    problem, rng = _Problem(traces), np.random.default_rng(0)
    width = traces[0].features.shape[2]
    best = min((problem.search(_start(rng, width), FIRST) for _ in range(STARTS)), key=problem.error)
    best = problem.search(best, LAST)
    record = {
        "coefficient": friction,
        "states": states,
        "error": problem.error(best),
        "errors": {p.name: _Problem([t]).error(best) for p, t in zip(walked, traces, strict=True)},
        "unfinished": [path.name for path in paths if not path.complete],
    }
    return replace(material, sliders=sliders_of(best), provenance={**material.provenance, "friction": record})


def _trace(material: CompactMaterial, path: FrictionPath) -> _Trace:
    known = np.isfinite(path.elastic).all(axis=1, keepdims=True)
    fitted = material.stress(path.strains) * material.scale
    elastic = np.where(known, path.elastic * material.scale, fitted)
    wanted = path.stresses * material.scale - elastic
    x = path.strains / material.scale
    moves = np.diff(x, axis=0)
    size = np.linalg.norm(elastic, axis=1) + np.linalg.norm(wanted + elastic, axis=1) + FLOOR
    # Every path counts alike, and of its stresses most those that do its work.
    moved = np.linalg.norm(moves, axis=0)
    weights = (_AT_REST + moved / max(float(moved.max()), 1e-300)) / size[:, None]
    weights /= max(float(np.linalg.norm(weights * wanted)), _LEAST)
    # Limits grow with the elastic stresses that the cloth will have.
    images = images_of(material.mirrored)
    pressures = np.array([[_pressures(side * sign * fitted) for side in (1.0, -1.0)] for sign in images])
    features, slopes = zip(*(_features(material, sign, x) for sign in images), strict=True)
    works = _works(moves, wanted + elastic)
    return _Trace(np.array(features), np.array(slopes), pressures, wanted, weights, works)


def _pressures(stress: Array) -> Array:
    """One and the parts of a stress (n, 6) along a spring and against it, (n, 13)."""
    return np.concatenate([np.ones((len(stress), 1)), np.maximum(stress, 0.0), np.maximum(-stress, 0.0)], axis=1)


def _features(material: CompactMaterial, sign: Array, x: Array) -> tuple[Array, Array]:
    """Scaled strains (n, 6) of an image and the steps there, (n, 6 + R); their derivatives (n, 6 + R, 6)."""
    steps = material.springs.steps * sign
    argument = material.springs.step_offsets + x @ steps.T
    root = 1.0 / np.sqrt(1.0 + argument * argument)
    slopes = np.concatenate([np.broadcast_to(np.diag(sign), (len(x), 6, 6)), root[:, :, None] ** 3 * steps], axis=1)
    return np.concatenate([sign * x, argument * root], axis=1), slopes


def _works(moves: Array, stress: Array) -> Array:
    """Matrices (rows, n, 6) that give works of a stress (n, 6): on each leg over the work done there, and on two legs
    out and back over what the loop takes."""
    legs = [slice(k, min(k + STEPS, len(moves))) for k in range(0, len(moves), STEPS)]
    rows = [(leg, False) for leg in legs]
    for out, back in pairwise(legs):
        if np.linalg.norm(moves[out.start : back.stop].sum(axis=0)) < _CLOSED * np.linalg.norm(moves[out].sum(axis=0)):
            rows.append((slice(out.start, back.stop), True))
    works = np.zeros((len(rows), len(stress), 6))
    for matrix, (leg, closed) in zip(works, rows, strict=True):
        after = slice(leg.start + 1, leg.stop + 1)
        matrix[leg] += 0.5 * moves[leg]
        matrix[after] += 0.5 * moves[leg]
        done = 0.5 * ((stress[leg] + stress[after]) * moves[leg]).sum(axis=1)
        size = float(np.abs(done).sum())
        if closed:
            size = max(abs(float(done.sum())), _LEAST_LOOP * size)
        matrix *= _OF_WORK / np.sqrt(len(rows)) / max(size, 1e-12)
    return works


def _start(rng: np.random.Generator, width: int) -> Array:
    """Unknowns (COUNT, width + 13) of random directions, from sliders that move at once to ones that hardly do."""
    directions = rng.normal(size=(COUNT, width))
    directions[:, 6:] *= 0.1
    slips = np.geomspace(_NARROW, _WIDE, COUNT)
    roots = np.sqrt(_GUESS / slips / COUNT)
    directions *= (roots / np.linalg.norm(directions[:, :6], axis=1))[:, None]
    growth = np.sqrt(slips * roots / np.sqrt(6.0))[:, None] * np.ones((1, 12))
    rest = np.sqrt(_AT_REST_LIMIT) * growth[:, :1]
    return np.concatenate([directions, rest, growth], axis=1)


def sliders_of(unknowns: Array) -> Sliders:
    """Sliders of unknowns (COUNT, 6 + R + 13)."""
    roots = np.maximum(np.linalg.norm(unknowns[:, :6], axis=1), 1e-9)  # those that faded away are zero
    directions, limits = unknowns[:, :-13] / roots[:, None], unknowns[:, -13:] ** 2 / roots[:, None]
    parts = limits[:, 0], limits[:, 1:7], limits[:, 7:]
    return Sliders.checked(directions[:, :6], directions[:, 6:], roots**2, *parts)


class _Problem:
    """Unknowns of each slider: √c a (6), √c b (R), and the roots (13) of √c y at rest and of its growth."""

    def __init__(self, traces: Sequence[_Trace]) -> None:
        self.traces = traces
        self.wanted = np.concatenate([_residuals(trace, trace.wanted[..., None])[:, 0] for trace in traces])

    def search(self, start: Array, evaluations: int) -> Array:
        """Better unknowns than those of a start, by the method of Levenberg and Marquardt."""
        best, damping, largest = start, 1e-2, np.full(start.size, 1e-3)
        missed, by = self._evaluated(best)
        for _ in range(evaluations):
            gradient = by.T @ missed + _SMALLNESS**2 * best.ravel()
            matrix = by.T @ by
            # Moré's scaling: sliders that rest or slide at present had larger derivatives, and may move again.
            largest = np.maximum(largest, matrix.diagonal())
            matrix[np.diag_indices_from(matrix)] += _SMALLNESS**2 + damping * largest
            tried = best - cho_solve(cho_factor(matrix), gradient).reshape(best.shape)
            new, new_by = self._evaluated(tried)
            if _size(new, tried) < _size(missed, best):
                best, missed, by, damping = tried, new, new_by, max(0.4 * damping, 1e-5)
            else:
                damping = min(3.0 * damping, 1e3)
        return best

    def error(self, unknowns: Array) -> float:
        """Norm of what is not met over that of all friction, both relative to elastic stresses."""
        missed = self._evaluated(unknowns)[0]
        return float(np.linalg.norm(missed) / max(np.linalg.norm(self.wanted), _LEAST))

    def _evaluated(self, unknowns: Array) -> tuple[Array, Array]:
        """What the sliders miss and its derivatives by the unknowns."""
        found = [friction_of(trace, unknowns) for trace in self.traces]
        values = [_residuals(t, stress[..., None])[:, 0] for t, (stress, _) in zip(self.traces, found, strict=True)]
        slopes = [_residuals(t, by) for t, (_, by) in zip(self.traces, found, strict=True)]
        return np.concatenate(values) - self.wanted, np.concatenate(slopes)


def _size(missed: Array, unknowns: Array) -> float:
    return float(missed @ missed + _SMALLNESS**2 * (unknowns * unknowns).sum())


def friction_of(trace: _Trace, unknowns: Array) -> tuple[Array, Array]:
    """Stress of friction (n, 6) over scaled strains along a path and its derivatives (n, 6, all unknowns)."""
    return _followed(trace.features, trace.slopes, trace.pressures, np.ascontiguousarray(unknowns))


def _residuals(trace: _Trace, stress: Array) -> Array:
    """Weighted stress and works of a stress (n, 6, ...) of friction."""
    flat = (stress * trace.weights[..., None])[1:].reshape(-1, stress.shape[2])
    works = trace.works.reshape(len(trace.works), -1) @ stress.reshape(-1, stress.shape[2])
    return np.concatenate([flat, works])


@numba.njit(cache=True, error_model="numpy")
def _followed(features: NDArray, slopes: NDArray, pressures: NDArray, unknowns: NDArray) -> tuple[NDArray, NDArray]:
    """``friction_of``: springs along features (I, n, f), see ``shell.materials.friction``."""
    images, n, f = features.shape
    count, size = unknowns.shape
    share_of_image = 1.0 / images
    stress, by = np.zeros((n, 6)), np.zeros((n, 6, count * size))
    step, slope, direction = np.zeros(f), np.zeros(size), np.zeros(6)
    for k in range(count):
        numbers, first = unknowns[k], k * size
        for image in range(images):
            pull = 0.0
            slope[:] = 0.0
            for i in range(1, n):
                u = pull
                for j in range(f):
                    step[j] = features[image, i, j] - features[image, i - 1, j]
                    u += numbers[j] * step[j]
                sign, side, y = (1.0, 0, LEAST_LIMIT) if u >= 0.0 else (-1.0, 1, LEAST_LIMIT)
                for j in range(size - f):
                    y += numbers[f + j] ** 2 * pressures[image, side, i - 1, j]
                width = 2.0 * ROUNDING * y
                over = abs(u) - (1.0 - ROUNDING) * y
                share, beyond = min(max(over / width, 0.0), 1.0), max(over - width, 0.0)
                pull = u - sign * (0.5 * width * share * share + beyond)
                by_limit = 0.0
                if share >= 1.0:
                    by_limit = sign
                elif share > 0.0:
                    by_limit = sign * share * (1.0 - ROUNDING + ROUNDING * share)
                for j in range(f):
                    slope[j] = (1.0 - share) * (slope[j] + step[j])
                for j in range(size - f):
                    slope[f + j] *= 1.0 - share
                    slope[f + j] += 2.0 * by_limit * numbers[f + j] * pressures[image, side, i - 1, j]
                direction[:] = 0.0
                for j in range(f):
                    for c in range(6):
                        direction[c] += share_of_image * numbers[j] * slopes[image, i, j, c]
                for c in range(6):
                    stress[i, c] += pull * direction[c]
                    for j in range(size):
                        by[i, c, first + j] += direction[c] * slope[j]
                    for j in range(f):
                        by[i, c, first + j] += share_of_image * pull * slopes[image, i, j, c]
    return stress, by

"""Weighted residuals of a compact energy at sampled states, and the search that lowers them.

A fabric's stresses span five decades: some mN/m where it is worn, tens of N/m where its yarns are straight. Residuals
are therefore relative to each state's own size, above a floor. Moduli count along their own eigenvectors, which are the
stiff and soft directions of a state.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, combinations, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.blas import ssyrk  # pyright: ignore[reportAttributeAccessIssue]
from scipy.optimize import nnls

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError
from yarnscale.homogenize.spring_jacobian import Directional, springs_of
from yarnscale.numerics.secant import SecantPairs
from yarnscale.numerics.threads import available_threads, run_parts
from yarnscale.shell.materials.compact import SpringNetwork

STRESS_FLOOR = 0.02
"""Stress [N/m], by strains in units, below which errors stop being relative: the weight of a centimetre of fabric."""
FIT_FLOOR = 0.25 * STRESS_FLOOR
"""The same for the fit, which has to meet the strain under that load, too."""
_MOMENT_FLOOR = 0.5
"""Floor at bent states without loads, over the median of their stress, if that is less than the usual floor."""
_LEAST_ALLOWED, _LEAST_USUAL = 0.1, 0.02
"""Allowed error of stress along the softest directions, as a part of that along stiff ones; in tension or bending."""
_BENT_POWER = 0.8
"""Power of the importance of tension that counts for states at rest and bent without loads."""
FEWEST_STATES = 10
_HUBER = 5.0
"""Residual from which the loss grows linearly."""
_SMALL, _LEAST_DIAGONAL, _AT_ONCE, _AT_REST = 1e-5, 1e-3, 120, 6.0
_PARTS = 8
"""Parts of the states whose sums are added in the end, whatever the number of threads."""
_SINGLE: Any = np.float32
_DAMPING, _LARGEST_DAMPING = 1e-2, 1e4
"""Of the first step of a stage at most, and that at which a stage ends."""
STAGES = (0.3, 0.1), (0.08, 0.1), (0.02, 0.15), (FIT_FLOOR, 0.65)
"""Floors of the search [N/m], and their shares of its iterations."""
_KEPT, _BACKTRACKS, _PLATEAU = 25, 8, 2e-4
"""Steps on one factor; trials of a step; relative gain below which a factor is renewed."""


@dataclass(frozen=True)
class CompactOptions:
    """How to fit.

    steps, springs: their number, of springs the largest. rounds: of the choice of springs. iterations: of the
    refinement. starts: of which the best is refined to the end. tolerance: relative error of stress and energy that
    counts as one. strain_tolerance: error of the strain, in units, that counts as one along soft directions.
    modulus_weight: of a relative error of a modulus beside one of stress. importance: of states under tension and
    those of own tests; its power 0.8 of those at rest and bent ones. symmetric: whether the fabric is its own mirror
    image, None to tell from the samples. seed: of the choice. Raises InputError for values out of range.
    """

    steps: int = 16
    springs: int = 40
    rounds: int = 40
    iterations: int = 400
    starts: int = 2
    tolerance: float = 0.03
    strain_tolerance: float = 0.01
    modulus_weight: float = 0.3
    importance: float = 5.0
    symmetric: bool | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        least = {"steps": 0, "springs": 1, "rounds": 1, "iterations": 0, "starts": 1, "seed": 0}
        for name, lowest in least.items():
            if not isinstance(found := getattr(self, name), int | np.integer) or found < lowest:
                raise InputError(name, expected=f"a whole number from {lowest} on", found=found)
        for name in ("tolerance", "strain_tolerance", "modulus_weight", "importance"):
            if not (np.isfinite(found := getattr(self, name)) and found > 0):
                raise InputError(name, expected="a positive number", found=found)


def stress_errors(fitted: Array, stresses: Array, scale: Array) -> tuple[Array, Array]:
    """Norms of stresses (n, 6) by strains in units of ``scale``; errors over these plus ``STRESS_FLOOR``; (n,) each."""
    norms = np.linalg.norm(stresses * scale, axis=1)
    return norms, np.linalg.norm((fitted - stresses) * scale, axis=1) / (norms + STRESS_FLOOR)


class StressErrors(NamedTuple):
    """Errors of the stress of some states, over the norm of their own stress plus ``STRESS_FLOOR``."""

    states: int
    median: float
    high: float
    """95th percentile."""
    mean: float

    @classmethod
    def of(cls, fitted: Array, stresses: Array, scale: Array) -> StressErrors:
        """Of stresses (n, 6) by strains in units of ``scale``."""
        if len(stresses) == 0:
            return cls(0, np.nan, np.nan, np.nan)
        error = stress_errors(fitted, stresses, scale)[1]
        return cls(len(stresses), float(np.median(error)), float(np.percentile(error, 95)), float(error.mean()))


@dataclass(frozen=True)
class Samples:
    """States x (n, 6), energies (n,), stresses (n, 6), moduli (n, 6, 6), all in units of strain; their kinds (n,)."""

    x: Array
    energies: Array
    stresses: Array
    moduli: Array
    kinds: NDArray[np.str_]

    @classmethod
    def of(
        cls,
        strains: ArrayLike,
        energies: ArrayLike,
        stresses: ArrayLike,
        moduli: ArrayLike | None,
        kinds: ArrayLike | None,
        scale: Array,
    ) -> Samples:
        x, energy, stress = (np.asarray(a, dtype=np.float64) for a in (strains, energies, stresses))
        modulus = np.full((len(x), 6, 6), np.nan) if moduli is None else np.asarray(moduli, dtype=np.float64)
        kind = np.full(len(x), "strain") if kinds is None else np.asarray(kinds, dtype=np.str_)
        for name, array, shape in (
            ("strains", x, (len(x), 6)),
            ("energies", energy, (len(x),)),
            ("stresses", stress, (len(x), 6)),
            ("moduli", modulus, (len(x), 6, 6)),
            ("kinds", kind, (len(x),)),
        ):
            if array.shape != shape:
                raise InputError(name, expected=f"shape {shape}", found=array.shape)
        good = np.isfinite(x).all(axis=1) & np.isfinite(energy) & np.isfinite(stress).all(axis=1)
        if good.sum() < FEWEST_STATES:
            raise InputError("states to fit", expected=f"at least {FEWEST_STATES}", found=int(good.sum()))
        modulus = modulus * scale[:, None] * scale
        return cls(x[good] / scale, energy[good], stress[good] * scale, modulus[good], kind[good])

    @cached_property
    def rest(self) -> int:
        """The state nearest to the undeformed one."""
        return int(np.argmin(np.abs(self.x).max(axis=1)))


class Problem:
    """Weighted residuals of a network at some samples."""

    def __init__(self, data: Samples, mirrored: bool, options: CompactOptions) -> None:
        self.data, self.options = data, options
        known = np.asarray(np.isfinite(data.moduli).all(axis=(1, 2)))
        moduli = np.where(known[:, None, None], data.moduli, np.eye(6))
        sizes, vectors = np.linalg.eigh(moduli)
        x, energies, stresses = data.x, data.energies, data.stresses
        # The undeformed state three times more, along the bisectors of its eigenvectors: they hold its modulus as a
        # whole, not its diagonal alone.
        pairs = [*combinations(range(6), 2), (0, 0), (1, 1), (2, 2)]
        axes = vectors[data.rest]
        bisectors = np.stack([axes[:, i] + axes[:, j] for i, j in pairs], axis=1)
        bisectors /= np.linalg.norm(bisectors, axis=0)
        means = np.array([np.sqrt(abs(sizes[data.rest, i] * sizes[data.rest, j])) for i, j in pairs])
        more = np.full(3, data.rest)
        self.x, self.energies = np.concatenate([x, x[more]]).T, np.append(energies, energies[more])
        self.v = np.concatenate([vectors, bisectors.reshape(6, 3, 6).transpose(1, 0, 2)]).transpose(1, 2, 0)
        stresses, moduli = np.concatenate([stresses, stresses[more]]), np.concatenate([moduli, moduli[more]])
        self.sizes = np.concatenate([np.abs(sizes), means.reshape(3, 6)]).T
        self.known, self.at_rest = np.append(known, known[more]), np.arange(len(x) + 3) >= len(x)
        self.at_rest[data.rest] = True
        slopes = np.einsum("imn,ni->mn", self.v, stresses)
        seconds = np.einsum("imn,nij,jmn->mn", self.v, moduli, self.v, optimize=True)
        self.target = np.concatenate([self.energies[None], slopes, seconds])
        self.norms = np.linalg.norm(stresses, axis=1)
        kinds = np.concatenate([data.kinds, data.kinds[more]])
        pulled, bent = np.isin(kinds, ("tension", "tested")), kinds == "bending"
        rather = np.where(bent | self.at_rest, options.importance**_BENT_POWER, 1.0)
        self.importance = np.where(pulled, options.importance, rather)
        self.least = np.where(pulled | bent, _LEAST_USUAL, _LEAST_ALLOWED)
        # Knits can be a thousand times softer in bending than in tension.
        moment = _MOMENT_FLOOR * float(np.median(self.norms[bent])) if bent.any() else FIT_FLOOR
        self.floors = np.where(bent | self.at_rest, min(1.0, moment / FIT_FLOOR), 1.0)
        self.states = Directional(self.x, self.v, mirrored=mirrored)
        self.coarse = Directional(self.x.astype(_SINGLE), self.v.astype(_SINGLE), mirrored=mirrored)

    def network(self, unknowns: Array) -> tuple[SpringNetwork, float]:
        """The springs, and the constant, of a vector of unknowns."""
        steps = self.options.steps
        return springs_of(unknowns, steps, (len(unknowns) - 7 * steps - 7) // (8 + steps))

    def weights(self, floor: float, *, at_rest: float = 1.0) -> Array:
        """Of the 13 outputs of every state, (13, n); at_rest: factor of the modulus of the undeformed state."""
        options, floors = self.options, floor * self.floors
        added = np.abs(self.energies - self.energies.min())
        allowed = self.norms + floors
        # Where fabric is soft, a small error of the stress is a large one of the strain.
        strained = options.strain_tolerance / options.tolerance * self.sizes
        slopes = np.where(self.known, np.clip(strained, self.least * allowed, allowed), allowed)
        # An error of the modulus is one of the stress a tenth of a unit of strain away.
        modulus_floor = np.where(self.at_rest, 0.3 / at_rest * floors, 10.0 * slopes)
        modulus = options.modulus_weight * self.known / (self.sizes + modulus_floor)
        modulus = np.where(self.at_rest, at_rest, 1.0) * modulus
        weights = np.concatenate([1.0 / (added + floor)[None], 1.0 / slopes, modulus])
        return weights * self.importance / options.tolerance

    def search(
        self, unknowns: Array, iterations: int, stages: Sequence[tuple[float, float]] = STAGES
    ) -> tuple[Array, list[int]]:
        """Descent by Gauss–Newton matrices that are kept for many steps; how many steps each stage took.

        A matrix costs ten times a gradient, and changes of the gradient correct it (L-BFGS). Floors fall from stage to
        stage: soft states bend valleys that the stiff ones have to find first.

        stages: floors with shares of iterations.
        """
        damping, done = _DAMPING, [0] * len(stages)
        for stage, (floor, share) in enumerate(stages):
            # Where one stage could go no further, the next may.
            damping = min(damping, _DAMPING)
            weights, left = self.weights(floor, at_rest=_AT_REST), round(share * iterations)
            while left > 0 and damping < _LARGEST_DAMPING:
                unknowns, taken, fraction = self._descend(unknowns, weights, damping, min(left, _KEPT))
                left -= max(1, taken)
                done[stage] += taken
                if fraction < 0.4:
                    damping *= 4.0 if fraction > 0 else 16.0
                elif fraction == 1.0:
                    damping = max(damping / 4.0, 1e-6)
        return unknowns, done

    def _descend(self, unknowns: Array, weights: Array, damping: float, steps: int) -> tuple[Array, int, float]:
        """Steps on one factor of the normal matrix, how many, and what fraction of the first was taken."""
        residuals = self._residuals(unknowns, weights)
        matrix, gradient = (
            self._normal(unknowns, weights, residuals),
            self._slope(unknowns, weights, residuals),
        )
        matrix[np.diag_indices(len(matrix))] += damping * (np.diag(matrix) + _LEAST_DIAGONAL)
        factor = cho_factor(matrix, overwrite_a=True, check_finite=False)
        changes, value, first, fraction = SecantPairs(_KEPT), self._loss(residuals), 0.0, 1.0
        for taken in range(steps):
            direction = changes.direction(gradient, lambda right: cho_solve(factor, right, check_finite=False))
            slope, fraction = 2.0 * float(gradient @ direction), min(1.0, 2.5 * fraction)
            for _ in range(_BACKTRACKS):
                there = unknowns + fraction * direction
                residuals = self._residuals(there, weights)
                trial = self._loss(residuals)
                if trial <= value + 1e-4 * fraction * slope:
                    break
                fraction *= float(np.clip(-0.5 * fraction * slope / (trial - value - fraction * slope), 0.1, 0.5))
            else:
                return unknowns, taken, first
            before, gradient = gradient, self._slope(there, weights, residuals)
            changes.add(there - unknowns, gradient - before)
            first, gain, unknowns, value = first or fraction, value - trial, there, trial
            if gain < _PLATEAU * value and taken > 3:
                break
        return unknowns, taken + 1, first

    def _by_parts(self, function: Callable[[slice], Array]) -> list[Array]:
        """``function`` of parts of the states, side by side; the same parts for any number of threads."""
        count = self.x.shape[1]
        ends = np.linspace(0, count, min(_PARTS, count) + 1).astype(int)
        parts = [slice(*pair) for pair in pairwise(ends)]
        threads = min(available_threads(), len(parts))
        groups = [parts[k * len(parts) // threads : (k + 1) * len(parts) // threads] for k in range(threads)]
        return list(chain(*run_parts(lambda group: [function(part) for part in group], groups)))

    @np.errstate(over="ignore", invalid="ignore")  # of a step that is too long
    def _residuals(self, unknowns: Array, weights: Array) -> Array:
        network = self.network(unknowns)

        @np.errstate(over="ignore", invalid="ignore")  # other threads do not know what this one ignores
        def part(place: slice) -> Array:
            return weights[:, place] * (self.states.part(place).values(*network) - self.target[:, place])

        return np.concatenate(self._by_parts(part), axis=1)

    def _slope(self, unknowns: Array, weights: Array, residuals: Array) -> Array:
        """Half of the gradient of the loss."""
        springs, adjoint = self.network(unknowns)[0], weights * np.clip(residuals, -_HUBER, _HUBER)
        return np.sum(
            self._by_parts(lambda place: self.states.part(place).pulled_back(springs, adjoint[:, place])), axis=0
        )

    def _loss(self, residuals: Array) -> float:
        size = np.abs(residuals)
        if not np.all(np.isfinite(size)):
            return np.inf
        near = np.minimum(size, _HUBER)
        with np.errstate(over="ignore"):  # a trial far off; infinite is rejected, too
            return float((near * (2 * size - near)).sum())

    def _normal(self, unknowns: Array, weights: Array, residuals: Array) -> Array:
        """Upper triangle of the matrix of the Gauss–Newton step, in single precision."""
        springs = self.network(unknowns)[0]
        scaled = weights * np.sqrt(np.minimum(1.0, _HUBER / np.maximum(np.abs(residuals), 1e-300)))
        scaled = scaled.T.astype(_SINGLE)[:, :, None]

        def part(place: slice) -> Array:
            matrix = np.zeros((len(unknowns), len(unknowns)), _SINGLE, order="F")
            for first in range(place.start, place.stop, _AT_ONCE):
                block = slice(first, min(first + _AT_ONCE, place.stop))
                rows = self.coarse.part(block).jacobian(springs)
                rows *= scaled[block]
                matrix = ssyrk(1.0, rows.reshape(-1, len(unknowns)).T, beta=1.0, c=matrix, overwrite_c=True)
            return matrix

        matrix = np.asarray(np.sum(self._by_parts(part), axis=0), np.float64)
        matrix[np.diag_indices(len(matrix))] += _SMALL
        return matrix

    def loss(self, unknowns: Array) -> float:
        """With the weights of the last stage."""
        return self._loss(self._residuals(unknowns, self.weights(FIT_FLOOR, at_rest=_AT_REST)))

    def errors(self, unknowns: Array) -> StressErrors:
        """Of the stress at the states."""
        x, along = self.data.x.T, np.repeat(np.eye(6)[:, :, None], len(self.data.x), axis=2)
        fitted = Directional(x, along, mirrored=len(self.states.signs) == 2).values(*self.network(unknowns))[1:7].T
        return StressErrors.of(fitted, self.data.stresses, np.ones(6))


class NonNegative(NamedTuple):
    """Least squares for numbers that are not negative but for the last one: normal matrix, right side, sizes."""

    matrix: Array
    right: Array
    size: Array
    least: float

    @classmethod
    def of(cls, columns: Array, weights: Array, target: Array) -> NonNegative:
        """Of weighted columns (m, 13, n), the last one a constant energy, and a target (13, n)."""
        kind, least, target = columns.dtype, float(target[0].min()), target.copy()
        target[0] -= least
        rows = (columns * weights.astype(kind)).reshape(-1, weights.size)
        # Rows of very stiff springs would overflow in single precision when multiplied.
        most = np.maximum(np.abs(rows).max(axis=1), kind.type(1e-30))
        rows /= most[:, None]
        right = (rows @ (weights * target).ravel().astype(kind)).astype(np.float64)
        matrix = (rows @ rows.T).astype(np.float64)
        size = np.sqrt(np.diag(matrix)) + 1e-300
        matrix, right, size = matrix / size / size[:, None], right / size, size * most
        matrix[np.diag_indices(len(matrix))] += 1e-4 if kind == _SINGLE else 1e-9
        return cls(matrix, right, size, least)

    def scaled(self, mine: Integers) -> Array:
        """The best numbers of some columns alone, times the size of the column."""
        lower = np.linalg.cholesky(self.matrix[np.ix_(mine, mine)])
        return nnls(lower.T, np.linalg.solve(lower, self.right[mine]), maxiter=30 * len(mine))[0]

    def solved(self, mine: Integers) -> Array:
        """The best numbers of some columns alone, the constant energy among them."""
        found = self.scaled(mine) / self.size[mine]
        found[-1] += self.least
        return found

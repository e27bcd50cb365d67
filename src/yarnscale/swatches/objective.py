"""How far a yarn model is from uniform data: rest shape, pulled states, residuals (EST22 eq. 11).

Residuals are the roots of the weighted terms of eq. 11: errors of σ/(1 + s) and of c over the largest target of the
comfort range, times the decaying weights, over the root of the number of samples; so the objective is a mean square.
Bending, which EST22 leaves out, may be added: logarithms of the ratios of the stiffness to that of the pear loops.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.swatches.measurements import between
from yarnscale.swatches.uniform_data import UniformCurve, UniformData, UniformErrors
from yarnscale.swatches.yarn_model import YarnModel
from yarnscale.swatches.yarn_rest import KEPT_PERIODS, RestedCell, RestRule, rested_cell
from yarnscale.swatches.yarn_states import YarnCurve, bending_stiffness, pulled

FAILED = 3.0
"""Error that counts for a state that did not converge."""
_SAME = 1e-5
"""Relative difference of energy below which two rest shapes are one; other starts of one shape change it by 1e-6."""


@dataclass(frozen=True)
class ErrorWeights:
    """How much errors of stress, of contraction and of bending weigh; zero leaves them out."""

    stress: float = 1.0
    contraction: float = 1.0
    bending: float = 0.0


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What a yarn with some parameters does.

    unknowns: (n,) in [0, 1]. residuals: (m,). curves: in the order of the data. periods: of the cell at rest [m].
    bending: stiffness along the directions of the data's loops (k,) [J], none where it has no weight.
    errors: of EST22 §8. solves: equilibria it took; seconds: of the processor. failed: states that are not at rest.
    """

    unknowns: Array
    residuals: Array
    curves: tuple[YarnCurve, ...]
    rested: RestedCell
    errors: UniformErrors
    solves: int
    seconds: float
    bending: Array = field(default_factory=lambda: np.empty(0))

    @property
    def objective(self) -> float:
        """Value of eq. 11."""
        return float(self.residuals @ self.residuals)

    @property
    def failed(self) -> int:
        """States that are not at rest."""
        return sum(int((~curve.converged).sum()) for curve in self.curves)

    def rests_lower(self, other: Evaluation) -> bool:
        """Whether the same yarn was found in another rest shape here, of lower energy; mirror images are the same."""
        return self.rested.energy < (1.0 - _SAME) * other.rested.energy


@dataclass(frozen=True, eq=False)
class YarnObjective:
    """Uniform data that a yarn model is compared with.

    rule: of the rest shape; by default ``RestRule`` for drawings that are schemes, ``KEPT_PERIODS`` for known shapes.
    """

    model: YarnModel
    data: UniformData
    rule: RestRule | None = None
    weights: ErrorWeights = field(default_factory=ErrorWeights)

    def __post_init__(self) -> None:
        if self.weights.bending > 0 and not self.data.bending:
            raise InputError(
                f"bending of '{self.data.name}'", expected="pear loops or bent strips", found="none measured"
            )

    def evaluate(self, unknowns: Array, *, near: Evaluation | None = None) -> Evaluation:
        """Rest shape and states of a yarn; ``near``: of a similar yarn, whose states are started from.

        Where that was pulled to other stretches, only its rest shape is.
        """
        began, unknowns = time.process_time(), np.array(unknowns, np.float64)
        values = self.model.values(unknowns)
        usual = RestRule() if self.model.free_shape else KEPT_PERIODS
        rested = rested_cell(
            self.model.cell(values), self.rule or usual, draw_in=self.model.draw_in(values),
            near=None if near is None else near.rested,
        )  # fmt: skip
        curves = []
        for k, target in enumerate(self.data.curves):
            if rested.relaxed:
                start = None if near is None else near.curves[k]
                if start is not None and not np.array_equal(start.stretch, target.stretch):
                    start = None
                curves.append(pulled(rested.cell, target.direction, target.stretch, near=start))
            else:
                n, none = len(target.stretch), np.zeros(len(target.stretch))
                lost = (none, none, np.zeros(n, bool), (), np.zeros((n, 2)), 0)
                curves.append(YarnCurve(target.direction, target.stretch, *lost))
        bending = self._bending(rested)
        solves = rested.solves + sum(curve.solves for curve in curves)
        solves += int(rested.relaxed and len(bending) > 0)
        pairs = zip(self.data.curves, curves, strict=True)
        residuals = np.concatenate([*(self._residuals(*pair) for pair in pairs), self._bent(bending)])
        errors = errors_of(curves, self.data)
        return Evaluation(
            unknowns, residuals, tuple(curves), rested, errors, solves, time.process_time() - began, bending
        )

    def _bending(self, rested: RestedCell) -> Array:
        if self.weights.bending <= 0:
            return np.empty(0)
        directions = [bend.direction for bend in self.data.bending]
        return bending_stiffness(rested.cell, directions) if rested.relaxed else np.full(len(directions), np.nan)

    def _bent(self, stiffness: Array) -> Array:
        """ln(k/k̂): k_b ranges over decades, and by ratios stiff yarns count no more than soft ones, (k,)."""
        if not len(stiffness):
            return stiffness
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.log(stiffness / [bend.stiffness for bend in self.data.bending])
        ratio = np.clip(np.nan_to_num(ratio, nan=FAILED, neginf=FAILED), -FAILED, FAILED)
        return np.sqrt(self.weights.bending / len(ratio)) * ratio

    def _residuals(self, target: UniformCurve, curve: YarnCurve) -> Array:
        stress = curve.stress / (1.0 + target.stretch) - target.second_stress
        residuals = self._scaled(target, stress[:, None], (curve.contraction - target.contraction)[:, None])[:, 0]
        good = np.tile(curve.converged, len(residuals) // len(curve.converged))
        failed = FAILED / np.sqrt(self._samples)
        return np.where(good, np.clip(np.nan_to_num(residuals), -failed, failed), failed)

    def _scaled(self, target: UniformCurve, stress: Array, contraction: Array) -> Array:
        """Differences (n, k) of stress and contraction as weighted residuals (2n, k)."""
        weight = np.sqrt(self.weights.stress * target.stress_decay / self._samples)
        rows = [weight[:, None] * stress / self.data.stress_scale]
        if self.weights.contraction > 0 and target.contraction_measured:
            weight = np.sqrt(self.weights.contraction * target.contraction_decay / self._samples)
            rows.append(weight[:, None] * contraction / self.data.contraction_scale)
        return np.concatenate(rows)

    @property
    def _samples(self) -> int:
        return sum(len(curve.stretch) for curve in self.data.curves)


def errors_of(curves: Sequence[YarnCurve], data: UniformData) -> UniformErrors:
    """Errors of a yarn's curves against data at the same stretches, without states that are not at rest."""
    return data.errors(
        [np.where(curve.converged, curve.stress, np.nan) for curve in curves],
        [np.where(curve.converged, curve.contraction, np.nan) for curve in curves],
    )


def coarser(data: UniformData, samples: int) -> UniformData:
    """The same curves at fewer stretches, evenly spaced to the largest; one at the end of the comfort range stays."""
    if samples < 2:
        raise InputError("samples per direction", expected="2 or more", found=samples)
    curves = []
    for curve in data.curves:
        stretch = curve.stretch[-1] * np.arange(1, samples + 1) / samples
        at = np.argmin(np.abs(stretch - curve.comfort_stretch))
        stretch[at] = min(curve.comfort_stretch, stretch[at]) if at == samples - 1 else curve.comfort_stretch

        known, stress, across = (np.append(0.0, part) for part in (curve.stretch, curve.stress, curve.contraction))
        stress, across = between(stretch, known, stress), between(stretch, known, across)
        curves.append(replace(curve, stretch=stretch, stress=stress, contraction=across))
    return replace(data, curves=tuple(curves))

"""Regularised Hessians, H + shift·M, and how the shift follows a minimisation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from yarnscale.arrays import Array
from yarnscale.numerics.factor import SymmetricPattern


@dataclass(frozen=True)
class ShiftRule:
    """How the regularisation moves: ``H + shift·M``.

    start, lowest, highest: its first value and bounds. A shift below ``lowest`` becomes 0 if ``lowest_is_zero``.
    growth: factor when a factorisation fails or a step disappoints; least: smallest value after growth.
    decay: factor after a step that did as predicted. hold_above: residual above which the shift stays at ``start``.
    """

    start: float = 1e-2
    lowest: float = 1e-9
    highest: float = math.inf
    growth: float = 5.0
    least: float = 1e-5
    decay: float = 0.3
    lowest_is_zero: bool = False
    hold_above: float = math.inf

    def raised(self, shift: float) -> float:
        """Next larger shift."""
        return min(max(shift * self.growth, self.least), self.highest)

    def decayed(self, shift: float, factor: float = 1.0) -> float:
        """Next smaller shift."""
        lower = shift * self.decay * factor
        if lower < self.lowest:
            return 0.0 if self.lowest_is_zero else self.lowest
        return lower


@dataclass(eq=False)
class ShiftedHessian:
    """H + shift·(D + T): entries of H, D diagonal, T further entries in ``pattern``.

    diagonal: (n,) of D; None: the mean magnitude of the diagonal of H. ties: of T; None: there are none.
    """

    pattern: SymmetricPattern
    entries: Array
    diagonal: Array | None = None
    ties: Array | None = None

    def values(self, shift: float) -> Array:
        """Entries of the regularised Hessian."""
        if shift == 0.0:
            return self.entries
        values = self.entries.copy() if self.ties is None else self.entries + shift * self.ties
        places = self.pattern.diagonal
        values[places] += shift * (np.abs(values[places]).mean() if self.diagonal is None else self.diagonal)
        return values

"""Changes of the gradient along past steps, which correct an old inverse Hessian (L-BFGS, Nocedal 1980)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from yarnscale.arrays import Array


@dataclass
class SecantPairs:
    """The last ``memory`` steps, (n,) each, with the changes of the gradient along them and the inverse curvatures."""

    memory: int
    _pairs: deque[tuple[Array, Array, float]] = field(init=False)

    def __post_init__(self) -> None:
        self._pairs = deque(maxlen=self.memory)

    def add(self, step: Array, change: Array) -> None:
        """Remember a step and the change of the gradient (n,); steps of no positive curvature tell nothing."""
        curvature = float(step @ change)
        if curvature > 1e-10 * float(np.linalg.norm(step) * np.linalg.norm(change)):
            self._pairs.append((step, change, 1.0 / curvature))

    def clear(self) -> None:
        self._pairs.clear()

    def direction(self, gradient: Array, solve: Callable[[Array], Array]) -> Array:
        """−H⁻¹ g by the two-loop recursion from the inverse Hessian ``solve``; its own where that is no descent."""
        rest, shares = -gradient, []
        for step, change, weight in reversed(self._pairs):
            shares.append(weight * float(step @ rest))
            rest = rest - shares[-1] * change
        direction = solve(rest)
        for (step, change, weight), share in zip(self._pairs, reversed(shares), strict=True):
            direction = direction + (share - weight * float(change @ direction)) * step
        if not self._pairs or float(gradient @ direction) < 0:
            return direction
        self.clear()
        return solve(-gradient)

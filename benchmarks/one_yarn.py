"""One yarn in several fabrics: its parameters fitted to the curves of all of them together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.swatches.evaluations import Evaluations, Residuals
from yarnscale.swatches.yarn_model import PARAMETERS, SHAPE, YarnModel

Array = NDArray[np.float64]


@dataclass(eq=False)
class SharedEvaluations:
    """Evaluations of several fabrics of one yarn, whose models are those of ``with_one_yarn``.

    Unknowns are the parameters of the yarn, then the shape of every fabric. Stands where ``Evaluations`` does in
    ``gauss_newton``; a fabric whose unknowns did not move is not evaluated again.
    """

    parts: tuple[Evaluations, ...]

    def split(self, unknowns: Array) -> list[Array]:
        """The unknowns of every fabric."""
        place, found = len(PARAMETERS), []
        for part in self.parts:
            own = len(SHAPE) if part.objective.model.free_shape else 0
            found.append(np.concatenate([unknowns[: len(PARAMETERS)], unknowns[place : place + own]]))
            place += own
        return found

    def joined(self, unknowns: Sequence[Array]) -> Array:
        """Unknowns of the whole from those of every fabric; the yarn in the middle of theirs."""
        n = len(PARAMETERS)
        return np.concatenate([np.median([u[:n] for u in unknowns], axis=0), *(u[n:] for u in unknowns)])

    @property
    def solves(self) -> int:
        """Equilibria of all fabrics."""
        return sum(part.solves for part in self.parts)

    @property
    def seconds(self) -> float:
        """Of the processor."""
        return sum(part.seconds for part in self.parts)

    def residuals(self, unknowns: Array) -> Array:
        """Residuals at one point."""
        return self.many([unknowns])[0].residuals

    def many(self, points: list[Array], *, near: Array | None = None, keep: bool = False) -> list[Residuals]:
        """Residuals at points, over the root of the number of fabrics."""
        columns = []
        for k, part in enumerate(self.parts):
            own = [self.split(point)[k] for point in points]
            start = None if near is None else self.split(near)[k]
            moved = [point for point in own if start is None or not np.array_equal(point, start)]
            found = iter(part.many(moved, near=start, keep=keep))
            still = [] if start is None else part.many([start])
            columns.append(
                [still[0] if start is not None and np.array_equal(point, start) else next(found) for point in own]
            )
        share = 1.0 / np.sqrt(len(self.parts))
        return [
            Residuals(share * np.concatenate([entry.residuals for entry in entries]), 0, 0.0)
            for entries in zip(*columns, strict=True)
        ]

    def settle(self, one: Array, other: Array) -> Array | None:
        """As of ``Evaluations``, of every fabric."""
        pairs = [(part, self.split(one)[k], self.split(other)[k]) for k, part in enumerate(self.parts)]
        settled = [(part.settle(own, beside), own) for part, own, beside in pairs]
        if any(found is own for found, own in settled):
            return one
        return other if any(found is not None for found, _ in settled) else None


def with_one_yarn(models: Sequence[YarnModel]) -> list[YarnModel]:
    """The models with one radius to count from, the median of their R_est. InputError for differing k_s2."""
    if len({model.stiffness for model in models}) != 1:
        raise InputError("k_s2 of fabrics of one yarn", expected="one value", found=[m.stiffness for m in models])
    radius = float(np.median([model.pattern.radius for model in models]))
    return [replace(model, pattern=replace(model.pattern, radius=radius)) for model in models]

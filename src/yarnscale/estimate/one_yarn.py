"""One yarn in several fabrics: its parameters fitted to the curves of all of them together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.estimate.objective import Evaluation, YarnObjective
from yarnscale.estimate.yarn_model import PARAMETERS, SHAPE, YarnModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SharedUnknowns:
    """Names of the unknowns of a shared yarn: its parameters, then the shape of every fabric."""

    names: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class SharedEvaluation:
    """The evaluations of all fabrics with one yarn; ``residuals`` of all, over the root of the number of fabrics."""

    parts: tuple[Evaluation, ...]

    @property
    def residuals(self) -> Array:
        """(m,)."""
        return np.concatenate([part.residuals for part in self.parts]) / np.sqrt(len(self.parts))

    @property
    def solves(self) -> int:
        """Equilibria of all fabrics."""
        return sum(part.solves for part in self.parts)

    @property
    def seconds(self) -> float:
        """Of the processor, for all fabrics."""
        return sum(part.seconds for part in self.parts)


@dataclass(frozen=True, eq=False)
class SharedObjective:
    """Several fabrics of one yarn, whose models count ranges from one radius and one stiffness (``with_one_yarn``).

    Stands where a ``YarnObjective`` does in ``Evaluations`` and the searches.
    """

    parts: tuple[YarnObjective, ...]

    @property
    def model(self) -> SharedUnknowns:
        """The unknowns."""
        shapes = [
            f"{name} of {part.data.name}" for part in self.parts if part.model.free_shape for name in SHAPE
        ]
        return SharedUnknowns((*PARAMETERS, *shapes))

    def split(self, unknowns: Array) -> list[Array]:
        """The unknowns of every fabric."""
        place, found = len(PARAMETERS), []
        for part in self.parts:
            own = len(SHAPE) if part.model.free_shape else 0
            found.append(np.concatenate([unknowns[: len(PARAMETERS)], unknowns[place : place + own]]))
            place += own
        return found

    def joined(self, unknowns: Sequence[Array]) -> Array:
        """Unknowns of the whole from those of every fabric; the yarn in the middle of theirs."""
        n = len(PARAMETERS)
        return np.concatenate([np.median([u[:n] for u in unknowns], axis=0), *(u[n:] for u in unknowns)])

    def evaluate(self, unknowns: Array, *, near: SharedEvaluation | None = None) -> SharedEvaluation:
        """Every fabric with the same yarn."""
        starts = [None] * len(self.parts) if near is None else near.parts
        own = zip(self.parts, self.split(unknowns), starts, strict=True)
        return SharedEvaluation(tuple(part.evaluate(u, near=start) for part, u, start in own))


def with_one_yarn(models: Sequence[YarnModel]) -> list[YarnModel]:
    """The models with one radius to count from, the median of their R_est. InputError for differing k_s2."""
    if len({model.stiffness for model in models}) != 1:
        raise InputError(
            "k_s2 of fabrics of one yarn", expected="one value", found=[m.stiffness for m in models]
        )
    radius = float(np.median([model.pattern.radius for model in models]))
    return [replace(model, pattern=replace(model.pattern, radius=radius)) for model in models]

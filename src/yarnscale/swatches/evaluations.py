"""Evaluations of an objective, each made once: over processes, remembered, and kept as they finish."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from yarnscale.arrays import Array
from yarnscale.homogenize.executors import DaskExecutor, is_loss
from yarnscale.numerics.threads import on_one_thread
from yarnscale.swatches.objective import Evaluation, YarnObjective

_WATCH = 1.0
"""How often workers that are silent are looked after [s]."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """Outcome of an evaluation: residuals (m,), equilibria and seconds it took."""

    residuals: Array
    solves: int
    seconds: float

    @property
    def objective(self) -> float:
        """Value of eq. 11."""
        return float(self.residuals @ self.residuals)


class Store(Protocol):
    """Where finished evaluations are kept; ``key`` names the objective's point and the one it was reached from."""

    def find(self, key: bytes) -> Residuals | None:
        """The evaluation of a key, if it is there."""
        ...

    def keep(self, key: bytes, unknowns: Array, found: Residuals) -> None:
        """Keep an evaluation, whole or not at all."""
        ...


@dataclass(eq=False)
class Evaluations:
    """Evaluates points of one objective; ``many`` at once over an executor's workers.

    store: where evaluations are looked up and kept; None: only in memory. count, solves, seconds: of all that were
    asked for, those found in the store included, so that a resumed run counts the same as one that was not
    interrupted. progress: called after every evaluation.
    """

    objective: YarnObjective
    executor: Executor | None = None
    store: Store | None = None
    progress: Callable[[Evaluations], None] | None = None
    count: int = 0
    solves: int = 0
    seconds: float = 0.0
    best: tuple[float, Array] | None = None
    _known: dict[bytes, Residuals] = field(default_factory=dict)
    _whole: dict[bytes, Evaluation] = field(default_factory=dict)
    _reached: dict[bytes, bytes] = field(default_factory=dict)
    """Points that are not known from their drawings, and from which states they are."""

    def residuals(self, unknowns: Array) -> Array:
        """Residuals (m,) at one point."""
        return self.many([unknowns])[0].residuals

    def many(self, points: Sequence[Array], *, near: Array | None = None, keep: bool = False) -> list[Residuals]:
        """Residuals at points, in their order; ``near``: a point close to all of them.

        keep: keep the states too, from which derivatives are computed.
        """
        fresh = list({point.tobytes(): point for point in points if self._find(point, near) is None}.values())
        start = self.whole(near) if near is not None and fresh else None
        for place, evaluation in self._run(fresh, start):
            self._keep(fresh[place], near, evaluation)
            if keep and near is None:
                self._whole[fresh[place].tobytes()] = evaluation
        found = [self._find(point, near) for point in points]
        return [entry for entry in found if entry is not None]

    def whole(self, point: Array) -> Evaluation:
        """The evaluation at a point with all its states; evaluated anew where only its residuals are kept."""
        key = point.tobytes()
        if key not in self._whole:
            _, self._whole[key] = next(self._run([point], None))
            if self._find(point, None) is None:
                self._keep(point, None, self._whole[key])
        return self._whole[key]

    def settle(self, one: Array, other: Array) -> Array | None:
        """Compare two yarns near each other, each also started from the states of the other one.

        Where one of them so converges to a rest shape of lower energy, that is its evaluation from here on, in ``many``
        and ``whole``, and it is returned.
        """
        for point, near in ((one, other), (other, one)):
            known, found = self.whole(point), self.beside(point, near)
            if found.rests_lower(known):
                # In memory alone: a resumed run makes the same comparison.
                place, key = point.tobytes(), self._key(point, near)
                self._known[place], self._whole[place], self._reached[place] = self._known[key], found, key
                return point
            if not known.rests_lower(found):
                break
        return None

    def beside(self, point: Array, near: Array) -> Evaluation:
        """The evaluation at a point with all its states, started from those of another one."""
        found = next(self._run([point], self.whole(near)))[1]
        if self._find(point, near) is None:
            self._keep(point, near, found)
        return found

    def _run(self, points: Sequence[Array], near: Evaluation | None) -> Iterator[tuple[int, Evaluation]]:
        """Evaluations and their places among the points, each as soon as it is there."""
        left = dict(enumerate(points))
        for place, evaluation in self._by_workers(points, near):
            del left[place]
            yield place, evaluation
        # This process does what no worker did.
        for place, point in left.items():
            yield place, evaluate(self.objective, point, near)

    def _by_workers(self, points: Sequence[Array], near: Evaluation | None) -> Iterator[tuple[int, Evaluation]]:
        """Evaluations by the executor's workers as they finish; no executor is left where workers died."""
        executor, running = self.executor, dict[Future[Evaluation], int]()
        if executor is None:
            return
        try:
            for place, point in enumerate(points):
                running[executor.submit(evaluate, self.objective, point, near)] = place
        except BrokenProcessPool:
            self.executor = None
        while running:
            finished, _ = wait(running, timeout=_WATCH, return_when=FIRST_COMPLETED)
            if isinstance(executor, DaskExecutor):
                executor.look()
            for future in finished:
                place = running.pop(future)
                try:
                    evaluation = future.result()
                except BaseException as error:
                    if not is_loss(error):
                        raise
                    self.executor = None
                    continue
                yield place, evaluation

    def _find(self, point: Array, near: Array | None) -> Residuals | None:
        key = self._key(point, near)
        if key not in self._known and self.store is not None:
            found = self.store.find(key)
            if found is not None:
                self._count(point, near, key, found)
        return self._known.get(key)

    def _keep(self, point: Array, near: Array | None, evaluation: Evaluation) -> None:
        key = self._key(point, near)
        found = Residuals(evaluation.residuals, evaluation.solves, evaluation.seconds)
        if self.store is not None:
            self.store.keep(key, point, found)
        self._count(point, near, key, found)

    def _key(self, point: Array, near: Array | None) -> bytes:
        place = b"" if near is None else near.tobytes()
        return point.tobytes() + place + self._reached.get(place, b"")

    def _count(self, point: Array, near: Array | None, key: bytes, found: Residuals) -> None:
        self._known[key] = found
        self.count, self.solves, self.seconds = (
            self.count + 1,
            self.solves + found.solves,
            self.seconds + found.seconds,
        )
        if near is None and (self.best is None or found.objective < self.best[0]):
            self.best = found.objective, np.array(point)
        if self.progress is not None:
            self.progress(self)


@on_one_thread
def evaluate(objective: YarnObjective, unknowns: Array, near: Evaluation | None) -> Evaluation:
    """One evaluation, run by a worker."""
    return objective.evaluate(unknowns, near=near)

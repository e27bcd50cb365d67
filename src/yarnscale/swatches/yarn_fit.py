"""Yarn parameters from uniform data: a search over the ranges, then refinement (EST22 §7.3)."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.swatches.evaluations import Evaluations, Store, evaluate
from yarnscale.swatches.gauss_newton import DIFFERENCE, gauss_newton, jacobian
from yarnscale.swatches.objective import ErrorWeights, Evaluation, YarnObjective, coarser
from yarnscale.swatches.search import PARTICLES, STEPS, cobyla, race, sobol_starts, swarm
from yarnscale.swatches.uniform_data import UniformData
from yarnscale.swatches.yarn_model import PARAMETERS, YarnModel
from yarnscale.swatches.yarn_rest import RestRule

Solver = Literal["sobol", "local", "paper"]
SOLVERS = ("sobol", "local", "paper")
"""``sobol``: scattered starts, Gauss–Newton from those that come down fastest; ``local``: Gauss–Newton from the middle
of the ranges; ``paper``: a swarm, then COBYLA at all stretches, as published."""
SEARCHED = 7
"""Stretches per direction during the search (EST22 §7.3.3)."""
STARTS, REFINED = 64, 8
"""Scattered points, and from how many of the best Gauss–Newton begins."""

_NOTHING = 1e-9
"""Change of unknowns, parts of their range, that should change nothing."""
AMBIGUOUS = 1e-3
"""Ambiguity from which there are two rest shapes."""
_GROWN = 0.01
"""Growth of the root of the objective up to which unknowns count as undetermined."""


@dataclass(frozen=True)
class FitOptions:
    """Options of the search; starts and refined belong to the solver ``sobol``; iterations: of Gauss–Newton
    at most."""

    solver: Solver = "sobol"
    seed: int = 0
    starts: int = STARTS
    refined: int = REFINED
    samples: int = SEARCHED
    iterations: int = 20

    def __post_init__(self) -> None:
        if self.solver not in SOLVERS:
            raise InputError("solver", expected=" or ".join(SOLVERS), found=self.solver)
        for name in ("starts", "refined", "samples", "iterations"):
            if getattr(self, name) < 1:
                raise InputError(name, expected="at least 1", found=getattr(self, name))


@dataclass(frozen=True, eq=False)
class ParameterSpread:
    """How well data fix the unknowns: J = U S Vᵀ of the residuals by the unknowns, which are shares of their ranges.

    singular: S (n,), largest first. vectors: rows of Vᵀ (n, n). shift: how far each unknown must go along its range
    until the root of the objective grows by 0.01 with all others following as far as their ranges go, (n,).
    """

    names: tuple[str, ...]
    singular: Array
    vectors: Array
    shift: Array

    @classmethod
    def of(cls, names: tuple[str, ...], slopes: Array) -> ParameterSpread:
        """From a Jacobian (m, n); where m < n, directions without effect on residuals have singular values 0."""
        _, felt, vectors = np.linalg.svd(slopes, full_matrices=True)
        singular = np.zeros(len(names))
        singular[: len(felt)] = felt
        # Ranges act as a residual of 0.01 would: an unknown without effect moves by 1, and moves no other further.
        inverse = vectors.T @ np.diag(1.0 / (singular**2 + _GROWN**2)) @ vectors
        return cls(names, singular, vectors, _GROWN * np.sqrt(np.diag(inverse)))


@dataclass(frozen=True, eq=False)
class YarnFit:
    """Estimated parameters: ``values`` by the names of the model, and what the yarn does with them.

    evaluation: at all samples of ``data``. spread: how well the values are fixed. ambiguity: largest change of the
    stress, over the largest of the comfort range, when the unknowns change by a billionth, or the yarn is started from
    the states of one a thousandth away; infinite where one has no equilibrium that the other has. evaluations, solves:
    of the search. cpu_seconds: of all processes; seconds: of the clock.
    """

    model: YarnModel
    data: UniformData
    values: Array
    evaluation: Evaluation
    spread: ParameterSpread
    ambiguity: float
    options: FitOptions
    objective: float
    evaluations: int
    solves: int
    cpu_seconds: float
    seconds: float

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Unknowns that ended at an end of their range."""
        at = (self.evaluation.unknowns < 1e-3) | (self.evaluation.unknowns > 1.0 - 1e-3)
        return tuple(name for name, end in zip(self.model.names, at, strict=True) if end)


def fit_yarn(
    model: YarnModel,
    data: UniformData,
    *,
    options: FitOptions | None = None,
    rule: RestRule | None = None,
    weights: ErrorWeights | None = None,
    executor: Executor | None = None,
    store: Callable[[YarnObjective], Store] | None = None,
    progress: Callable[[Evaluations], None] | None = None,
    start: Array | None = None,
) -> YarnFit:
    """Find the parameters with which a yarn model follows uniform data.

    start: unknowns from which Gauss–Newton begins, in place of a search.

    executor: runs evaluations side by side. store: keeps evaluations, so that a killed run can continue.
    progress: called after every evaluation. The result depends on ``options.seed``, not on workers.
    """
    options, began = options or FitOptions(), time.perf_counter()
    objective = YarnObjective(model, coarser(data, options.samples), rule, weights or ErrorWeights())
    searches = [Evaluations(objective, executor, None if store is None else store(objective), progress)]
    if start is not None:
        unknowns = gauss_newton(searches[0], start, iterations=options.iterations)
    elif options.solver == "paper":
        fine = replace(objective, data=data)
        searches.append(Evaluations(fine, executor, None if store is None else store(fine), progress))
        unknowns = cobyla(searches[1], swarm(searches[0], seed=options.seed))
    else:
        unknowns = searched(searches[0], options)
    last, ambiguous = searches[-1], ambiguity(searches[-1], unknowns)
    lower = ambiguous > AMBIGUOUS and last.settle(unknowns, unknowns + DIFFERENCE * _inwards(unknowns)) is unknowns
    if lower and options.solver != "paper":
        # It rests lower than was known: the descent goes on there.
        unknowns = gauss_newton(last, unknowns, iterations=options.iterations)
        ambiguous = ambiguity(last, unknowns)
    slopes = jacobian(last, unknowns)
    value = last.many([unknowns])[0].objective
    final = evaluate(replace(objective, data=data), unknowns, last.whole(unknowns))
    return YarnFit(
        model, data, model.values(unknowns), final, ParameterSpread.of(model.names, slopes), ambiguous, options, value,
        sum(s.count for s in searches) + 1, sum(s.solves for s in (*searches, final)),
        sum(s.seconds for s in (*searches, final)), time.perf_counter() - began,
    )  # fmt: skip


def _inwards(unknowns: Array) -> Array:
    """Signs of changes that stay within the ranges."""
    return np.where(unknowns > 0.5, -1.0, 1.0)


def ambiguity(evaluations: Evaluations, unknowns: Array) -> float:
    """Largest change of the stress where the rest shape is found from another start, as of ``YarnFit``."""
    known, inwards = evaluations.whole(unknowns), _inwards(unknowns)
    nearby = unknowns + DIFFERENCE * inwards
    others = evaluations.beside(unknowns, nearby), evaluations.whole(unknowns + _NOTHING * inwards)
    return max(_difference(known, other, evaluations.objective.data) for other in others)


def _difference(one: Evaluation, other: Evaluation, data: UniformData) -> float:
    """Largest difference of the stress of two evaluations, over the largest of the comfort range."""
    differences = [
        np.where(a.converged == b.converged, np.where(a.converged, np.abs(a.stress - b.stress), 0.0), np.inf)
        for a, b in zip(one.curves, other.curves, strict=True)
    ]
    return float(np.concatenate(differences).max()) / data.stress_scale


def searched(evaluations: Evaluations, options: FitOptions) -> Array:
    """The best unknowns that a solver finds."""
    model = evaluations.objective.model
    if options.solver == "local":
        return gauss_newton(evaluations, middle(model), iterations=options.iterations)
    starts = sobol_starts(evaluations, options.starts, options.refined, seed=options.seed)
    starts += usual_starts(model)
    return race(evaluations, starts, iterations=options.iterations)


def middle(model: YarnModel) -> Array:
    """The middle of the ranges; the drawing as it is where its shape is unknown."""
    return np.array([0.0 if name in ("shortening", "draw_in") else 0.5 for name in model.names])


def usual_starts(model: YarnModel) -> list[Array]:
    """Where the shape is free, a yarn like those of fitted stockinette and garter, drawn in by three quarters.

    Always begins the race, whatever its objective: among scattered points in eight dimensions few are folded ribs of
    plausible yarn, and a rib whose search begins at a flat one stays flat.
    """
    if not model.free_shape:
        return []
    usual = {"k_s1": 0.8, "knee": 0.65, "k_b": 0.3, "R_1": 0.65, "k_c1": 0.8}
    shape = {"aspect": 0.5, "shortening": 0.2, "draw_in": 0.75}
    return [np.array([(usual | shape)[name] for name in model.names])]


def work_ahead(options: FitOptions, unknowns: int) -> int:
    """About how many evaluations a search takes, for the time left."""
    if options.solver == "paper":
        return PARTICLES * STEPS
    # A Jacobian and a pair of tries now and then, pairs of tries in between.
    steps = min(12, options.iterations) * (0.4 * unknowns + 2)
    refined = options.refined + (1 if unknowns > len(PARAMETERS) else 0)
    return int(steps if options.solver == "local" else options.starts + (0.4 * refined + 1) * steps)

"""Load paths to the equilibrium of a cell: direct solves, load paths through intermediate states, perturbed starts."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.energy import CellEnergy
from yarnscale.cell.equilibrium import Equilibrium, EquilibriumOptions, Start
from yarnscale.cell.passages import has_passages, jump_is_safe, linked_differently, safe_move
from yarnscale.kinematics import ShellStrain
from yarnscale.numerics.linear_solver import linear_solver
from yarnscale.numerics.newton import NewtonOptions, Solution, Status, minimise
from yarnscale.numerics.regularisation import ShiftRule
from yarnscale.yarn.friction_pairs import FrictionPairs
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.stiffness import Materials

LARGEST_HALVING = 4
"""How often the load path from rest to a state is halved when the direct solve does not converge."""
FEWEST_STEPS = 4
"""Steps from rest to a state where the direct solve failed."""
PATIENCE = 4
"""Factor on the iterations of a last attempt where no load path has converged."""
NOISE = 0.1
"""Standard deviation of the noise of every coordinate [r]."""
WAVE = 0.6
"""Largest height of each of the waves across the cell, out of and in the plane [r]."""
_WAVES = ((1, 0), (0, 1), (1, 1), (1, -1))

_Reached = tuple[CellEnergy, Solution]


@dataclass(frozen=True, eq=False)
class Continuation:
    """Equilibria of a pattern of a material, found as ``options`` say; other fields: as in ``PeriodicCell``."""

    pattern: YarnPattern
    material: Materials
    sliding: bool
    options: EquilibriumOptions
    friction_pairs: FrictionPairs | None = None

    def energy(self, strain: ShellStrain) -> CellEnergy:
        """The energy under a state."""
        return CellEnergy(self.pattern, self.material, strain, self.sliding, friction_pairs=self.friction_pairs)

    def equilibrium(self, strain: ShellStrain, start: Start | None, *, nearby: bool = False) -> Equilibrium:
        """The equilibrium under a state, from a start or from rest; arguments as those of ``PeriodicCell.relax``."""
        began = time.perf_counter()
        rest, target = np.zeros(6), strain.vector
        if nearby and start is not None:
            energy, solution = self._near_start(strain, start)
        else:
            paths: list[Callable[[], _Reached | None]] = []
            if start is not None:
                paths.append(lambda: self._from_start(strain, start))
            paths.append(lambda: self._continued(rest, target, None, LARGEST_HALVING))
            if target.any():
                paths.append(lambda: self._stepwise(target))
            energy, solution = self._first_good(paths)
        if self.sliding:
            solution = self._released(energy, solution, start, nearby)
        if self.options.starts > 1:
            solution = self._lowest(energy, solution)
        # No step moves yarns through each other (``CellEnergy.bound``); this checks the whole path.
        passages = math.isfinite(solution.value) and linked_differently(energy, solution.x)
        return Equilibrium.of(energy, solution, time.perf_counter() - began, passages=passages)

    def _first_good(self, paths: list[Callable[[], _Reached | None]]) -> _Reached:
        """The first load path that converges; else the first outcome, with more iterations where it needs them."""
        best: _Reached | None = None
        for path in paths:
            found = path()
            if found is not None and found[1].converged:
                return found
            if best is None or not math.isfinite(best[1].value):
                best = found or best
        assert best is not None
        if best[1].status is Status.ITERATION_LIMIT:
            best = best[0], self._given_time(*best)
        return best

    def _near_start(self, strain: ShellStrain, start: Start) -> _Reached:
        """What one solve from a start leads to; the start itself where yarns would have passages under the state."""
        energy = self.energy(strain)
        x = energy.start(*self._scaled(start))
        return energy, self._minimised(energy, x, 0 if has_passages(energy, x) else None)

    def _from_start(self, strain: ShellStrain, start: Start) -> _Reached | None:
        """The load path from a start, direct or through intermediate states; None where it is another fabric."""
        scaled = self._scaled(start)
        energy = self.energy(strain)
        x = energy.start(*scaled)
        direct: _Reached | None = None
        if not has_passages(energy, x):
            direct = energy, self._minimised(energy, x)
            if direct[1].converged:
                return direct
        if not self._is_this_fabric(start.strain, scaled):
            return direct
        return self._continued(start.strain.vector, strain.vector, scaled, LARGEST_HALVING, direct)

    def _scaled(self, start: Start) -> tuple[Array, Array]:
        """Fluctuation [r] and twist of a start."""
        return start.fluctuation / self.pattern.radius, start.twist

    def _is_this_fabric(self, strain: ShellStrain, scaled: tuple[Array, Array]) -> bool:
        """Whether yarns can move from the drawing to a fluctuation [r] and twist without passing through each other.

        From two starts: the drawing, and the equilibrium that the drawing relaxes to.
        """
        energy = self.energy(strain)
        x = energy.start(*scaled)
        if not has_passages(energy, x):
            return True
        if linked_differently(energy, x):
            return False
        relaxed = self._minimised(energy, energy.start())
        return relaxed.converged and safe_move(energy, relaxed.x, x)

    def _given_time(self, energy: CellEnergy, solution: Solution) -> Solution:
        """An unfinished solve, continued: loose yarns touch and part many times before they rest."""
        further = self._minimised(energy, solution.x, PATIENCE * self.options.max_iterations)
        return _with_work(further, solution)

    def _released(self, energy: CellEnergy, solution: Solution, start: Start | None, nearby: bool) -> Solution:
        """The lower of an equilibrium and the one that yarns slide to from where they are held.

        Sliding yarns catch on each other's vertices, so the first start alone may end above that without sliding.
        """
        held = replace(self, sliding=False).equilibrium(energy.strain, start, nearby=nearby)
        other = self._minimised(energy, energy.start(*self._scaled(held)))
        better = other.converged and (not solution.converged or other.value < solution.value)
        return _with_work(other, solution, held) if better else _with_work(solution, other, held)

    def _stepwise(self, strain: Array) -> _Reached | None:
        """From rest in equal steps, each from the equilibrium before."""
        seed, solutions, energy = None, [], None
        for step in range(1, FEWEST_STEPS + 1):
            before, here = (step - 1) / FEWEST_STEPS * strain, step / FEWEST_STEPS * strain
            reached = self._continued(before, here, seed, LARGEST_HALVING)
            if reached is None:
                return None
            energy, solution = reached
            solutions.append(solution)
            seed = energy.split(solution.x)
        assert energy is not None
        return energy, _with_work(solutions.pop(), *solutions)

    def _lowest(self, energy: CellEnergy, solution: Solution) -> Solution:
        """The lowest equilibrium found from perturbed starts about a first one."""
        best, others, generator = solution, [], np.random.default_rng(self.options.seed)
        for _ in range(self.options.starts - 1):
            other = self._minimised(energy, perturbed(energy, solution.x, generator))
            if other.converged and (not best.converged or other.value < best.value):
                best, other = other, best
            others.append(other)
        return _with_work(best, *others)

    def _minimised(self, energy: CellEnergy, start: Array, iterations: int | None = None) -> Solution:
        most = self.options.max_iterations if iterations is None else iterations
        shift = ShiftRule(start=self.options.shift)
        options = NewtonOptions(self.options.tolerance, max_iterations=most, shift=shift, reuse=energy.reuse)
        linear = linear_solver(energy.constraints)
        return minimise(energy, start, options, linear=linear, bound=energy.bound, watch=self.options.watch)

    def _continued(
        self,
        origin: Array,
        strain: Array,
        seed: tuple[Array, Array] | None,
        halvings: int,
        direct: _Reached | None = None,
    ) -> _Reached | None:
        """Solve at ``strain`` from a seed at ``origin``; where that fails, through the state half-way.

        A seed that yarns would have to pass each other for, were the state changed at once, fails without a try. None
        where no path was found on which they do not. direct: the outcome of the direct solve, if known.
        """
        energy = self.energy(ShellStrain.from_vector(strain))
        start = energy.start(*(seed or (None, None)))
        last = halvings == 0 or np.array_equal(origin, strain)
        if direct is None and (seed is None or jump_is_safe(energy, start, ShellStrain.from_vector(origin))):
            direct = energy, self._minimised(energy, start)
        if last or (direct is not None and direct[1].converged):
            return direct
        middle = 0.5 * (origin + strain)
        half = self._continued(origin, middle, seed, halvings - 1)
        if half is None or not half[1].converged:
            return direct
        further = self._continued(middle, strain, half[0].split(half[1].x), halvings - 1)
        if further is None:
            return direct
        return further[0], _with_work(further[1], half[1], *([] if direct is None else [direct[1]]))


def _with_work(solution: Solution, *others: Solution | Equilibrium) -> Solution:
    """A solution whose counts of work include those of others."""
    return replace(
        solution,
        iterations=solution.iterations + sum(other.iterations for other in others),
        factorisations=solution.factorisations + sum(other.factorisations for other in others),
    )


def perturbed(energy: CellEnergy, x: Array, generator: np.random.Generator) -> Array:
    """A free vector near ``x``: noise on every vertex and waves of the cell's own period, the ones of buckling.

    The perturbation is shortened until no yarn passes another and the energy is finite.
    """
    n, pattern = energy.count, energy.pattern
    moves = NOISE * generator.standard_normal((n, 3))
    place = pattern.vertices[:, :2] / pattern.period
    for wave in _WAVES:
        phase, height = generator.uniform(0.0, 2.0 * np.pi), generator.uniform(-WAVE, WAVE, 3)
        moves += np.cos(2.0 * np.pi * (place @ np.array(wave)) + phase)[:, None] * height * (0.5, 0.5, 1.0)
    step = np.concatenate([moves.ravel(), np.zeros(n)])
    step = energy.constraints.project(step)
    for _ in range(6):
        if safe_move(energy, x, x + step) and np.isfinite(energy.value(x + step)):
            return x + step
        step = 0.5 * step
    return x

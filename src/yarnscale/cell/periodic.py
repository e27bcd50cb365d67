"""A periodic cell of yarn and its equilibria under macroscopic states (HYLC20 §5), with exact stress and moduli."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.cell.energy import CellEnergy
from yarnscale.cell.equilibrium import Equilibrium
from yarnscale.cell.passages import has_passages, jump_is_safe, linked_differently, safe_move
from yarnscale.cell.poisson import cell_midsurface
from yarnscale.cell.sensitivity import Sensitivities, response, sensitivities
from yarnscale.cell.starts import perturbed
from yarnscale.checked import checked
from yarnscale.errors import InputError
from yarnscale.kinematics import ShellStrain
from yarnscale.numerics.linear_solver import linear_solver
from yarnscale.numerics.newton import NewtonOptions, Solution, Status, Watch, minimise
from yarnscale.numerics.threads import on_one_thread
from yarnscale.yarn.material import YarnMaterial
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.stiffness import Materials, PatternStiffness, materials_of

LARGEST_HALVING = 4
"""How often the load path from rest to a state is halved when the direct solve does not converge."""
FEWEST_STEPS = 4
"""Steps from rest to a state where the direct solve failed."""
PATIENCE = 4
"""Factor on the iterations of a last attempt where no load path has converged."""


_Reached = tuple[CellEnergy, Solution]


@checked
@dataclass(frozen=True, eq=False)
class PeriodicCell:
    """One period of a pattern made of a yarn material.

    material: one for all yarns, or a sequence that the pattern's ``yarn_material`` numbers; kept as a tuple then.
    sliding: whether each yarn may slide along itself as a whole; fixed by default, as published (EST22 §7.1).
    tolerance, max_iterations: of the equilibrium solves. starts: how many starts compete for the lowest energy, the
    others being random perturbations of the first equilibrium, drawn with ``seed``. watch: called at every iteration of
    every solve with its number and the residual.
    """

    pattern: YarnPattern
    material: Materials
    sliding: bool = False
    tolerance: float = 1e-6
    max_iterations: int = 400
    backend: str | None = field(default=None, kw_only=True)
    starts: int = field(default=1, kw_only=True)
    seed: int = field(default=0, kw_only=True)
    watch: Watch | None = field(default=None, kw_only=True, repr=False)

    def __post_init__(self) -> None:
        if self.starts < 1:
            raise InputError("number of starts", expected="at least 1", found=self.starts)
        if not isinstance(self.material, YarnMaterial):
            object.__setattr__(self, "material", materials_of(self.pattern, self.material))

    def __repr__(self) -> str:
        return f"PeriodicCell({self.pattern!r} of {self.material_name})"

    @property
    def materials(self) -> tuple[YarnMaterial, ...]:
        """Materials by their number; one where it is that of all yarns."""
        return materials_of(self.pattern, self.material)

    @property
    def material_name(self) -> str:
        """Names of the materials."""
        return " + ".join(material.name for material in self.materials)

    @property
    def area_density(self) -> float:
        """Mass per reference area [kg/m²]."""
        return PatternStiffness.of(self.pattern, self.material).area_density()

    def energy(self, strain: ShellStrain) -> CellEnergy:
        """The energy of this cell under any state, as an objective of fluctuations and twists."""
        return CellEnergy(self.pattern, self.material, strain, self.sliding, not strain.is_flat)

    def warm_up(self, strain: ShellStrain | None = None) -> None:
        """Compile or load what solves need, so that none of them pays for it."""
        energy = self.energy(ShellStrain() if strain is None else strain)
        start = energy.start()
        energy.value(start)
        energy.quadratic(start)
        energy.stress(start)

    @checked
    def relax(self, strain: ShellStrain | None = None, *, start: Equilibrium | None = None) -> Equilibrium:
        """The equilibrium under a macroscopic state, from rest or from a neighbouring equilibrium.

        Where the direct solve does not converge or yarns would pass through each other, intermediate states are
        relaxed first; a start with passages is left aside. Look at ``status`` and ``passages``.
        """
        strain = ShellStrain() if strain is None else strain
        seed = None if start is None or start.passages else (start.strain, start.fluctuation, start.twist)
        return self.relax_from(strain, seed)

    @on_one_thread
    def relax_from(
        self, strain: ShellStrain, seed: tuple[ShellStrain, Array, Array] | None, *, nearby: bool = False
    ) -> Equilibrium:
        """``relax`` from a state's strain, fluctuation (n, 3) [m] and twist (n,); None: from rest.

        nearby: one solve from the seed, which may fail; otherwise intermediate states and paths from rest are tried.
        """
        began = time.perf_counter()
        rest, target = np.zeros(6), strain.vector
        if nearby and seed is not None:
            energy, solution = self._near_seed(target, seed)
        else:
            ways: list[Callable[[], _Reached | None]] = []
            if seed is not None:
                ways.append(lambda: self._from_seed(target, seed))
            ways.append(lambda: self._continued(rest, target, None, LARGEST_HALVING))
            if target.any():
                ways.append(lambda: self._stepwise(target))
            energy, solution = self._first_good(ways)
        if self.sliding:
            solution = self._released(energy, solution, seed, nearby)
        if self.starts > 1:
            solution = self._lowest(energy, solution)
        # No step moves yarns through each other (``CellEnergy.bound``); this checks the whole path.
        passages = math.isfinite(solution.value) and linked_differently(energy, solution.x)
        return self._equilibrium(energy, solution, time.perf_counter() - began, passages=passages)

    def _first_good(self, ways: list[Callable[[], _Reached | None]]) -> _Reached:
        """The first load path that converges; else the first outcome, with more iterations where it needs them."""
        best: _Reached | None = None
        for way in ways:
            found = way()
            if found is not None and found[1].converged:
                return found
            if best is None or not math.isfinite(best[1].value):
                best = found or best
        assert best is not None
        if best[1].status is Status.ITERATION_LIMIT:
            best = best[0], self._given_time(*best)
        return best

    def _near_seed(self, target: Array, seed: tuple[ShellStrain, Array, Array]) -> _Reached:
        """What one solve from a seed leads to; the seed itself where its yarns would have passages under the target."""
        energy = self.energy(ShellStrain.from_vector(target))
        start = energy.start(seed[1] / self.pattern.radius, seed[2])
        cell = replace(self, max_iterations=0) if has_passages(energy, start) else self
        return energy, cell._minimised(energy, start)

    def _from_seed(self, target: Array, seed: tuple[ShellStrain, Array, Array]) -> _Reached | None:
        """The load path from a seed, direct or through intermediate states; None where it is another fabric."""
        scaled = seed[1] / self.pattern.radius, seed[2]
        energy = self.energy(ShellStrain.from_vector(target))
        start = energy.start(*scaled)
        direct: _Reached | None = None
        if not has_passages(energy, start):
            direct = energy, self._minimised(energy, start)
            if direct[1].converged:
                return direct
        if not self._is_this_fabric(seed[0], scaled):
            return direct
        return self._continued(seed[0].vector, target, scaled, LARGEST_HALVING, direct)

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
        patient = replace(self, max_iterations=PATIENCE * self.max_iterations)
        further = patient._minimised(energy, solution.x)
        return _with_work(further, solution)

    def _released(
        self,
        energy: CellEnergy,
        solution: Solution,
        seed: tuple[ShellStrain, Array, Array] | None,
        nearby: bool,
    ) -> Solution:
        """The lower of an equilibrium and the one that yarns slide to from where they are held.

        Sliding yarns catch on each other's vertices, so the first start alone may end above that without sliding.
        """
        held = replace(self, sliding=False).relax_from(energy.strain, seed, nearby=nearby)
        other = self._minimised(energy, energy.start(held.fluctuation / self.pattern.radius, held.twist))
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
        best, others, generator = solution, [], np.random.default_rng(self.seed)
        for _ in range(self.starts - 1):
            other = self._minimised(energy, perturbed(energy, solution.x, generator))
            if other.converged and (not best.converged or other.value < best.value):
                best, other = other, best
            others.append(other)
        return _with_work(best, *others)

    def _minimised(self, energy: CellEnergy, start: Array) -> Solution:
        options = NewtonOptions(self.tolerance, max_iterations=self.max_iterations, reuse=energy.reuse)
        linear = linear_solver(energy.constraints, self.backend)
        return minimise(energy, start, options, linear=linear, bound=energy.bound, watch=self.watch)

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

    def _equilibrium(
        self, energy: CellEnergy, solution: Solution, seconds: float, *, passages: bool
    ) -> Equilibrium:
        unit, gaps = energy.unit / self.pattern.area, energy.gaps(solution.x)
        fluctuation, twist = energy.split(solution.x)
        return Equilibrium(
            strain=energy.strain,
            positions=energy.positions(solution.x),
            twist=twist.copy(),
            fluctuation=fluctuation * self.pattern.radius,
            energy_density=solution.value * unit,
            energy_parts=energy.parts(solution.x),
            stress=energy.stress(solution.x),
            status=solution.status,
            residual=solution.residual,
            iterations=solution.iterations,
            factorisations=solution.factorisations,
            seconds=seconds,
            contacts=int((gaps < 1.0).sum()),
            min_distance_over_diameter=float(gaps.min(initial=np.inf)),
            passages=passages,
        )

    def placement(self, state: Equilibrium | None) -> Callable[[Integers, Integers], Array]:
        """Positions of copies: a function of vertices (k,) and tiles (k, 2) to (k, 3) [m]; None: as drawn."""
        radius, n = self.pattern.radius, len(self.pattern.edges)
        surface = cell_midsurface(self.pattern, ShellStrain() if state is None else state.strain)
        fluctuation = np.zeros((n, 3)) if state is None else state.fluctuation

        def place(vertices: Integers, tiles: Integers) -> Array:
            reference = self.pattern.vertices[vertices].copy()
            reference[:, :2] += tiles * self.pattern.period
            points, rotations = surface.at(reference / radius)
            return points * radius + np.einsum("nij,nj->ni", rotations, fluctuation[vertices])

        return place

    def midsurface_grid(self, state: Equilibrium, *, rings: int = 1, points: int = 25) -> Array:
        """Points of the midsurface over the tile and ``rings`` rings of copies, (points, points, 3) [m]."""
        radius = self.pattern.radius
        centre = 0.5 * (self.pattern.vertices.min(axis=0) + self.pattern.vertices.max(axis=0))[:2]
        sides = (
            np.linspace(-rings - 0.5, rings + 0.5, points) * p + c
            for p, c in zip(self.pattern.period, centre, strict=True)
        )
        grid = np.stack(np.meshgrid(*sides, indexing="ij"), -1).reshape(-1, 2)
        surface = cell_midsurface(self.pattern, state.strain)
        flat, _ = surface.at(np.column_stack([grid, np.zeros(len(grid))]) / radius)
        return (flat * radius).reshape(points, points, 3)

    @on_one_thread
    @checked
    def moduli(self, state: Equilibrium) -> Array:
        """∂²Ψ/∂z² (6, 6) at an equilibrium, z = (s_x, s_a, s_y, II11, II12, II22) (theory §2).

        One solve per component with one factorisation. Units follow ``stress``; valid at every equilibrium.
        """
        return response(self.energy(state.strain), state, self.backend).moduli

    @checked
    def sensitivities(self, state: Equilibrium) -> Sensitivities:
        """Derivatives of energy density and stress by material parameters and rest lengths, at an equilibrium."""
        return sensitivities(self.energy(state.strain), state, self.backend)


def _with_work(solution: Solution, *others: Solution | Equilibrium) -> Solution:
    """A solution whose counts of work include those of others."""
    return replace(
        solution,
        iterations=solution.iterations + sum(other.iterations for other in others),
        factorisations=solution.factorisations + sum(other.factorisations for other in others),
    )

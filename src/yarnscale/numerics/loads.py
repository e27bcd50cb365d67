"""Homogeneous fabric under loads: the strain at which its stress is in equilibrium with them.

Fabric has an energy density Ψ(z) of the macroscopic strain z = (s_x, s_a, s_y, II11, II12, II22). Loads do not follow
its motion (dead loads), and some strains may be held, so the equilibrium minimises

    Π(z) = Ψ(z) − f·z − Σ_k σ_k λ_k(z)   with   A z = b.                                                    (L1)

f are loads conjugate to the strains: in-plane [N/m], moments [N]. λ_k = |F u_k| is the stretch of the material line
that lies along the unit vector u_k at rest (``kinematics.line_stretch``), and σ_k a tension along it [N per metre of
rest width]. The first Piola–Kirchhoff stress of σ λ is P = σ (F u / |F u|) ⊗ u: a strip that is cut along u and pulled
at its ends has tension σ, its long sides are free (P v = 0 for v ⟂ u), and it may shear. As λ depends on I = FᵀF alone,
the rotation needs no unknown: that one minimises Π which turns F u into the direction of the pull.

One Newton method serves cells of yarns and shell materials: ``HomogeneousFabric`` is what it needs of either.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.kinematics import COMPONENTS, line_stretch
from yarnscale.numerics.newton import Status

Array = NDArray[np.float64]

RADIUS = 0.12
"""Largest change of a scaled strain in one step."""
HELD_RADIUS = 0.5
"""Largest change of a held scaled strain in one step."""
FLOOR = 1e-5
"""Residual of the load that counts as none, however small the load is [N/m]."""
_SMALLEST_SIDE, _LARGEST_SHEAR = 0.05, 0.97
_HALVINGS = 6
_ESCAPES = 3
_SUFFICIENT = 1e-4


def _places(names: Iterable[str]) -> list[int]:
    """Where strains stand in a strain vector, by their names."""
    unknown = [name for name in names if name not in COMPONENTS]
    if unknown:
        raise InputError("strain", expected=", ".join(COMPONENTS), found=unknown[0])
    return [COMPONENTS.index(name) for name in names]


@dataclass(frozen=True, eq=False)
class Response:
    """Fabric under one strain: energy density [J/m²], stress (6,), and whether it is an equilibrium of this fabric.

    state: whatever the fabric needs to go on from here.
    """

    strain: Array
    energy: float
    stress: Array
    usable: bool = True
    state: Any = None


class HomogeneousFabric(Protocol):
    """Fabric that answers to a macroscopic strain: a periodic cell of yarns, or a shell material."""

    @property
    def strain_scale(self) -> Array:
        """Strains (6,) of like importance, by which steps and residuals are measured."""
        ...

    def response(self, strain: Array, start: Response | None = None) -> Response:
        """Energy and stress under a strain (6,), from a neighbouring response or from rest."""
        ...

    def moduli(self, response: Response) -> Array:
        """Second derivatives of the energy (6, 6); ArithmeticError where there are none (the verge of buckling)."""
        ...


@dataclass(frozen=True)
class Loads:
    """Dead loads on homogeneous fabric.

    stress: conjugate to (s_x, s_a, s_y) [N/m] and (II11, II12, II22) [N]. tensions: pairs (angle from the course
    [rad], load per metre of rest width [N/m]) along material lines.
    """

    stress: tuple[float, ...] = (0.0,) * 6
    tensions: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        if len(self.stress) != 6 or not all(map(math.isfinite, self.stress)):
            raise InputError("loads", expected="six finite numbers", found=self.stress)
        for angle, load in self.tensions:
            if not (math.isfinite(angle) and math.isfinite(load)):
                raise InputError("tension", expected="a finite angle and load", found=(angle, load))

    @classmethod
    def tension(cls, angle: float, load: float) -> Loads:
        """A strip along an angle from the course [rad], pulled by a load [N/m], free across and to shear."""
        return cls(tensions=((float(angle), float(load)),))

    @classmethod
    def components(cls, **loads: float) -> Loads:
        """Loads conjugate to strains, by the strains' names; the others are zero."""
        stress = np.zeros(6)
        stress[_places(loads)] = list(loads.values())
        return cls(tuple(float(v) for v in stress))

    def __add__(self, other: Loads) -> Loads:
        total = np.add(self.stress, other.stress)
        return Loads(tuple(float(v) for v in total), self.tensions + other.tensions)

    def work(self, strain: Array) -> tuple[float, Array, Array]:
        """f·z + Σ σ (λ − 1) [J/m²], its gradient (6,) and second derivative (6, 6)."""
        gradient, second = np.array(self.stress), np.zeros((6, 6))
        value = float(gradient @ strain)
        for angle, load in self.tensions:
            stretch, slope, bend = line_stretch(strain, angle)
            value += load * (stretch - 1.0)
            gradient, second = gradient + load * slope, second + load * bend
        return value, gradient, second


@dataclass(frozen=True, eq=False)
class Held:
    """Strains that are held: matrix (m, 6) @ strain = values (m,)."""

    matrix: Array = field(default_factory=lambda: np.zeros((0, 6)))
    values: Array = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def components(cls, **values: float) -> Held:
        """Strains by their names, at given values."""
        return cls(np.eye(6)[_places(values)], np.array(list(values.values()), np.float64))

    @classmethod
    def curvature(cls, angle: float, value: float) -> Held:
        """The normal curvature [1/m] along an angle from the course [rad]; the other curvatures are free."""
        c, s = math.cos(angle), math.sin(angle)
        return cls(np.array([[0.0, 0.0, 0.0, c * c, 2 * c * s, s * s]]), np.array([float(value)]))

    @classmethod
    def bent(cls, angle: float, value: float) -> Held:
        """All curvatures: a cylinder bent by a curvature [1/m] along an angle [rad]; flat where it is zero."""
        c, s = math.cos(angle), math.sin(angle)
        return cls.components(II11=value * c * c, II12=value * c * s, II22=value * s * s)

    def __add__(self, other: Held) -> Held:
        return Held(np.concatenate([self.matrix, other.matrix]), np.concatenate([self.values, other.values]))


FLAT = Held.bent(0.0, 0.0)
"""Curvature held at zero."""


@dataclass(frozen=True, eq=False)
class LoadedState:
    """Outcome of ``equilibrium_under``.

    response: the fabric there. moduli: (6, 6), NaN where it has none. residual: norm of what is missing of the loads,
    in scaled strains [N/m], over those that may move.
    evaluations: strains at which the fabric was asked.
    """

    response: Response
    moduli: Array
    residual: float
    status: Status
    evaluations: int

    @property
    def strain(self) -> Array:
        """Strain (6,)."""
        return self.response.strain

    @property
    def stress(self) -> Array:
        """Stress (6,), in-plane [N/m], moments [N]."""
        return self.response.stress

    @property
    def energy(self) -> float:
        """Energy density [J/m²]."""
        return self.response.energy

    @property
    def converged(self) -> bool:
        """Whether the loads are met, at a minimum."""
        return self.status is Status.CONVERGED


Visit = Callable[[Response, Array], None]


def equilibrium_under(
    fabric: HomogeneousFabric,
    loads: Loads,
    *,
    held: Held | None = None,
    start: LoadedState | None = None,
    tolerance: float = 1e-3,
    floor: float = FLOOR,
    radius: float = RADIUS,
    max_iterations: int = 60,
    visit: Visit | None = None,
) -> LoadedState:
    """The equilibrium under ``loads`` with some strains ``held`` (L1), from rest or from a neighbouring one.

    Newton with the fabric's moduli, negative ones turned positive, in steps of at most ``radius`` in scaled strains;
    held strains are moved to their values in the same steps. tolerance: on the missing load over all loads; floor
    [N/m]: missing load that is none. visit: called with every new response on the way and its moduli (NaN where there
    are none). Look at ``status``.
    """
    return _LoadedNewton(
        fabric, loads, held or Held(), (tolerance, floor), radius, max_iterations, visit
    ).run(start)


def path_under(
    fabric: HomogeneousFabric, loads: Iterable[Loads], *, start: LoadedState | None = None, **options: Any
) -> Sequence[LoadedState]:
    """Equilibria under one load after the other, each from the one before; options as ``equilibrium_under``.

    The first step under a new load is the prediction by the moduli. A state that is no equilibrium is not gone on from.
    """
    found: list[LoadedState] = []
    for load in loads:
        state = equilibrium_under(fabric, load, start=start, **options)
        found.append(state)
        start = state if state.converged else start
    return found


class _LoadedNewton:
    """Π in scaled strains, and the affine space in which it is minimised."""

    def __init__(
        self, fabric: HomogeneousFabric, loads: Loads, held: Held, tolerance: tuple[float, float], radius: float,
        max_iterations: int, visit: Visit | None,
    ) -> None:  # fmt: skip
        self.fabric, self.loads, self.held, self.visit = fabric, loads, held, visit
        self.max_iterations = max_iterations
        self.scale = np.asarray(fabric.strain_scale, np.float64)
        matrix = held.matrix * self.scale
        _, sizes, rows = np.linalg.svd(matrix)
        rank = int((sizes > 1e-12 * sizes.max(initial=0.0)).sum())
        self.free = rows[rank:].T
        self.to_held = np.linalg.pinv(matrix)
        (self.tolerance, self.floor), self.radius = tolerance, radius
        self.evaluations = 0
        self.known = np.full((6, 6), np.nan)

    def run(self, start: LoadedState | None) -> LoadedState:
        here = self._ask(np.zeros(6), None) if start is None else start.response
        if not here.usable:
            return self._outcome(here, Status.INVALID)
        moduli = self._moduli(here) if start is None else start.moduli
        self.known = moduli if np.isfinite(moduli).all() else self.known
        radius, escapes = self.radius, 0
        for iteration in range(self.max_iterations + 1):
            gradient, hessian = self._slope(here), self._curvature(here)
            gap = self.to_held @ (self.held.values - self.held.matrix @ here.strain)
            if np.abs(gap).max() < 1e-12 and self._missing(gradient) <= self._enough(here):
                way_out = self._descent_direction(hessian, gradient)
                if way_out is None or escapes >= _ESCAPES:
                    ended = Status.CONVERGED if way_out is None else Status.STALLED
                    return self._outcome(here, ended, moduli)
                step, escapes = 0.25 * RADIUS * way_out, escapes + 1
            elif iteration == self.max_iterations:
                break
            else:
                gap = _shortened(gap, HELD_RADIUS)
                step = self._newton_step(gradient + hessian @ gap, hessian)
            step = _shortened(step, radius)
            fraction, there = self._search(
                here, gradient, gap + step, moving=bool(np.abs(gap).max() >= 1e-12)
            )
            if there is None:
                return self._outcome(here, Status.STALLED, moduli)
            whole = float(np.abs(step).max())
            radius = (
                min(2.0 * radius, self.radius) if fraction == 1.0 else max(fraction * whole, 1e-4 * RADIUS)
            )
            here, moduli = there, self._moduli(there)
        return self._outcome(here, Status.ITERATION_LIMIT, moduli)

    def _ask(self, strain: Array, start: Response | None) -> Response:
        self.evaluations += 1
        return self.fabric.response(strain, start)

    def _moduli(self, response: Response) -> Array:
        """Moduli there, NaN where there are none; the last ones that were finite are kept to go on with."""
        try:
            moduli = self.fabric.moduli(response)
        except ArithmeticError:
            moduli = np.full((6, 6), np.nan)
        if np.isfinite(moduli).all():
            self.known = moduli
        if self.visit is not None:
            self.visit(response, moduli)
        return moduli

    def _slope(self, response: Response) -> Array:
        """Gradient of Π by the scaled strains (6,)."""
        return (response.stress - self.loads.work(response.strain)[1]) * self.scale

    def _curvature(self, response: Response) -> Array:
        """Second derivative of Π by the scaled strains (6, 6)."""
        known = self.known if np.isfinite(self.known).all() else np.diag(1.0 / self.scale**2)
        return (known - self.loads.work(response.strain)[2]) * self.scale[:, None] * self.scale

    def _missing(self, gradient: Array) -> float:
        return float(np.linalg.norm(self.free.T @ gradient))

    def _enough(self, response: Response) -> float:
        """Residual at which the loads count as met."""
        asked = self.free.T @ (self.loads.work(response.strain)[1] * self.scale)
        return self.tolerance * float(np.linalg.norm(asked)) + self.floor

    def _newton_step(self, gradient: Array, hessian: Array) -> Array:
        """Step along the free strains, by the Hessian with its eigenvalues made positive."""
        values, vectors = np.linalg.eigh(self.free.T @ hessian @ self.free)
        values = np.maximum(np.abs(values), 1e-7 * np.abs(values).max(initial=0.0) + 1e-12)
        return -self.free @ (vectors @ ((vectors.T @ (self.free.T @ gradient)) / values))

    def _descent_direction(self, hessian: Array, gradient: Array) -> Array | None:
        """Where Π falls from a point without slope; None at a minimum."""
        values, vectors = np.linalg.eigh(self.free.T @ hessian @ self.free)
        if not len(values) or values[0] >= -1e-3 * np.abs(values).max() - 10 * FLOOR:
            return None
        direction = self.free @ vectors[:, 0]
        downhill = -math.copysign(1.0, float(direction @ gradient))
        return downhill * direction / np.abs(direction).max()

    def _search(
        self, here: Response, gradient: Array, step: Array, *, moving: bool
    ) -> tuple[float, Response | None]:
        """The first of ever shorter steps that lowers Π or the residual; any, while held strains are moving."""
        before, slope = here.energy - self.loads.work(here.strain)[0], float(gradient @ step)
        residual, fraction = self._missing(gradient), 1.0
        for _ in range(_HALVINGS):
            strain = here.strain + fraction * step * self.scale
            if _admissible(strain):
                there = self._ask(strain, here)
                if there.usable:
                    gained = before - (there.energy - self.loads.work(strain)[0])
                    lower = gained >= -_SUFFICIENT * fraction * min(slope, 0.0) and gained > 0
                    if moving or lower or self._missing(self._slope(there)) <= 0.9 * residual:
                        return fraction, there
            fraction *= 0.5 if fraction > 0.3 else 0.3
        return 0.0, None

    def _outcome(self, response: Response, status: Status, moduli: Array | None = None) -> LoadedState:
        gradient = self._slope(response) if response.usable else np.full(6, np.inf)
        if moduli is None:
            moduli = np.full((6, 6), np.nan)
        return LoadedState(response, moduli, self._missing(gradient), status, self.evaluations)


def _shortened(step: Array, longest: float) -> Array:
    """A step whose largest component is at most ``longest``."""
    return step * min(1.0, longest / max(float(np.abs(step).max()), 1e-300))


def _admissible(strain: Array) -> bool:
    return bool(min(strain[0], strain[2]) > _SMALLEST_SIDE - 1 and abs(strain[1]) < _LARGEST_SHEAR)

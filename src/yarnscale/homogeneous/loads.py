"""Homogeneous fabric under loads: the strain at which its stress is in equilibrium with them.

Fabric has an energy density Ψ(z) of the macroscopic strain z = (s_x, s_a, s_y, II11, II12, II22). Loads do not follow
its motion (dead loads), and some strains may be prescribed, so the equilibrium minimises

    Π(z) = Ψ(z) − f·z − Σ_k σ_k λ_k(z)   with   A z = b.                                                    (L1)

f are loads conjugate to the strains: in-plane [N/m], moments [N]. λ_k = |F u_k| is the stretch of the material line
that lies along the unit vector u_k at rest (``kinematics.line_stretch``), and σ_k a tension along it [N per metre of
rest width]. The first Piola–Kirchhoff stress of σ λ is P = σ (F u / |F u|) ⊗ u: a strip that is cut along u and pulled
at its ends has tension σ, its long sides are free (P v = 0 for v ⟂ u), and it may shear. As λ depends on I = FᵀF alone,
the rotation needs no unknown: that one minimises Π which turns F u into the direction of the pull.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.homogeneous.fabrics import HomogeneousFabric, Response, moduli_or_nan
from yarnscale.kinematics import COMPONENTS, line_stretch
from yarnscale.numerics.newton import Status

RADIUS = 0.12
"""Largest change of a scaled strain in one step."""
PRESCRIBED_RADIUS = 0.5
"""Largest change of a prescribed scaled strain in one step."""
FLOOR = 1e-5
"""Residual of the load that counts as none, however small the load is [N/m]."""
_SMALLEST_SIDE, _LARGEST_SHEAR = 0.05, 0.97
_HALVINGS = 6
_ESCAPES = 3
"""Saddle points that are left, at most."""
_SUFFICIENT = 1e-4


def _places(names: Iterable[str]) -> list[int]:
    """Where strains stand in a strain vector, by their names."""
    unknown = [name for name in names if name not in COMPONENTS]
    if unknown:
        raise InputError("strain", expected=", ".join(COMPONENTS), found=unknown[0])
    return [COMPONENTS.index(name) for name in names]


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
class Prescribed:
    """Strains that are prescribed: matrix (m, 6) @ strain = values (m,)."""

    matrix: Array = field(default_factory=lambda: np.zeros((0, 6)))
    values: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if self.matrix.shape != (len(self.values), 6):
            raise InputError(
                "prescribed strains", expected=f"a matrix ({len(self.values)}, 6)", found=self.matrix.shape
            )
        if not (np.isfinite(self.matrix).all() and np.isfinite(self.values).all()):
            raise InputError("prescribed strains", expected="finite numbers", found=self.values.tolist())

    @classmethod
    def components(cls, **values: float) -> Prescribed:
        """Strains by their names, at given values."""
        return cls(np.eye(6)[_places(values)], np.array(list(values.values()), np.float64))

    @classmethod
    def bent(cls, angle: float, value: float) -> Prescribed:
        """All curvatures: a cylinder bent by a curvature [1/m] along an angle [rad]; flat where it is zero."""
        c, s = math.cos(angle), math.sin(angle)
        return cls.components(II11=value * c * c, II12=value * c * s, II22=value * s * s)

    def __add__(self, other: Prescribed) -> Prescribed:
        return Prescribed(np.concatenate([self.matrix, other.matrix]), np.concatenate([self.values, other.values]))


FLAT = Prescribed.bent(0.0, 0.0)
"""No curvature."""


@dataclass(frozen=True, eq=False)
class LoadedState:
    """Outcome of ``equilibrium_under``.

    response: the fabric there. moduli: (6, 6), NaN where it has none. residual: norm of the unbalanced loads, in scaled
    strains [N/m], over those that are not prescribed. evaluations: strains at which the fabric was evaluated.
    """

    response: Response
    moduli: Array
    residual: float
    status: Status
    evaluations: int

    @property
    def strain(self) -> Array:
        return self.response.strain

    @property
    def stress(self) -> Array:
        """Stress (6,), in-plane [N/m], moments [N]."""
        return self.response.stress

    @property
    def energy(self) -> float:
        return self.response.energy

    @property
    def converged(self) -> bool:
        """Whether the loads are met, at a minimum."""
        return self.status is Status.CONVERGED


Observer = Callable[[Response, Array], None]


def equilibrium_under(
    fabric: HomogeneousFabric,
    loads: Loads,
    *,
    prescribed: Prescribed | None = None,
    start: LoadedState | Response | None = None,
    tolerance: float = 1e-3,
    floor: float = FLOOR,
    radius: float = RADIUS,
    max_iterations: int = 60,
    observe: Observer | None = None,
) -> LoadedState:
    """The equilibrium under ``loads`` with some strains ``prescribed`` (L1), from rest or from a neighbouring one.

    Newton with the fabric's moduli, negative ones turned positive, in steps of at most ``radius`` in scaled strains;
    prescribed strains reach their values in the same steps. tolerance: on the residual over all loads; floor [N/m]:
    residual that is none. observe: called with every new response and its moduli (NaN where there are none). Look at
    ``status``.
    """
    method = _LoadedNewton(fabric, loads, prescribed or Prescribed(), (tolerance, floor), radius, observe)
    return method.run(start, max_iterations)


def path_under(fabric: HomogeneousFabric, loads: Iterable[Loads], **options: Any) -> Sequence[LoadedState]:
    """Equilibria under one load after the other, each from the one before; options as ``equilibrium_under``.

    The first step under a new load is the prediction by the moduli. No state starts from one that is no equilibrium.
    """
    found: list[LoadedState] = []
    start: LoadedState | None = None
    for load in loads:
        state = equilibrium_under(fabric, load, start=start, **options)
        found.append(state)
        start = state if state.converged else start
    return found


class _LoadedNewton:
    """Π in scaled strains, and the affine space in which it is minimised."""

    def __init__(
        self, fabric: HomogeneousFabric, loads: Loads, prescribed: Prescribed, tolerance: tuple[float, float],
        radius: float, observe: Observer | None,
    ) -> None:  # fmt: skip
        self.fabric, self.loads, self.prescribed, self.observe = fabric, loads, prescribed, observe
        self.scale = np.asarray(fabric.strain_scale, np.float64)
        matrix = prescribed.matrix * self.scale
        _, sizes, rows = np.linalg.svd(matrix)
        rank = int((sizes > 1e-12 * sizes.max(initial=0.0)).sum())
        self.free = rows[rank:].T
        self.to_prescribed = np.linalg.pinv(matrix)
        (self.tolerance, self.floor), self.radius = tolerance, radius
        self.evaluations = 0
        self.last_moduli = np.diag(1.0 / self.scale**2)

    def run(self, start: LoadedState | Response | None, max_iterations: int) -> LoadedState:
        here = self._respond(np.zeros(6), None) if start is None else start
        here, known = (here.response, here.moduli) if isinstance(here, LoadedState) else (here, None)
        if not here.usable:
            return self._outcome(here, Status.INVALID)
        moduli = self._moduli(here) if known is None else known
        self.last_moduli = moduli if np.isfinite(moduli).all() else self.last_moduli
        radius, escapes, least = self.radius, 0, math.inf
        for iteration in range(max_iterations + 1):
            gradient, hessian = self._gradient(here), self._hessian(here)
            gap = self.to_prescribed @ (self.prescribed.values - self.prescribed.matrix @ here.strain)
            moving = bool(np.abs(gap).max() >= 1e-12)
            balanced = not moving and self._residual(gradient) <= self._allowed(here)
            if balanced:
                descent = self._descent_direction(hessian, gradient)
                if descent is None or escapes >= _ESCAPES:
                    return self._outcome(here, Status.CONVERGED if descent is None else Status.STALLED, moduli)
                step, escapes = 0.25 * RADIUS * descent, escapes + 1
            elif iteration == max_iterations:
                break
            else:
                gap = _shortened(gap, PRESCRIBED_RADIUS)
                step = self._newton_step(gradient + hessian @ gap, hessian)
            step = _shortened(step, radius)
            least = math.inf if moving else min(least, self._residual(gradient))
            fraction, there = self._search(here, gradient, gap + step, least, moving=moving)
            # Away from a saddle residuals rise: its own is no measure of the next ones.
            least = math.inf if balanced else least
            if there is None:
                return self._outcome(here, Status.STALLED, moduli)
            whole = float(np.abs(step).max())
            radius = min(2.0 * radius, self.radius) if fraction == 1.0 else max(fraction * whole, 1e-4 * RADIUS)
            here, moduli = there, self._moduli(there)
        return self._outcome(here, Status.ITERATION_LIMIT, moduli)

    def _respond(self, strain: Array, start: Response | None) -> Response:
        self.evaluations += 1
        return self.fabric.response(strain, start)

    def _moduli(self, response: Response) -> Array:
        """Moduli there, NaN where there are none; the last ones that were finite serve the next steps."""
        moduli = moduli_or_nan(self.fabric, response)
        if np.isfinite(moduli).all():
            self.last_moduli = moduli
        if self.observe is not None:
            self.observe(response, moduli)
        return moduli

    def _gradient(self, response: Response) -> Array:
        """Gradient of Π by the scaled strains (6,)."""
        return (response.stress - self.loads.work(response.strain)[1]) * self.scale

    def _hessian(self, response: Response) -> Array:
        """Second derivative of Π by the scaled strains (6, 6)."""
        return (self.last_moduli - self.loads.work(response.strain)[2]) * self.scale[:, None] * self.scale

    def _residual(self, gradient: Array) -> float:
        return float(np.linalg.norm(self.free.T @ gradient))

    def _allowed(self, response: Response) -> float:
        """Residual at which the loads count as balanced."""
        loads = self.free.T @ (self.loads.work(response.strain)[1] * self.scale)
        return self.tolerance * float(np.linalg.norm(loads)) + self.floor

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
        self, here: Response, gradient: Array, step: Array, least: float, *, moving: bool
    ) -> tuple[float, Response | None]:
        """The first of ever shorter steps that lowers Π or the least residual; any, while prescribed strains move.

        The least of all iterations, since Newton's method may go to and fro across a slider's limit.
        """
        before, slope = here.energy - self.loads.work(here.strain)[0], float(gradient @ step)
        fraction = 1.0
        for _ in range(_HALVINGS):
            strain = here.strain + fraction * step * self.scale
            if _admissible(strain):
                there = self._respond(strain, here)
                if there.usable:
                    gained = before - (there.energy - self.loads.work(strain)[0])
                    lower = gained >= -_SUFFICIENT * fraction * min(slope, 0.0) and gained > 0
                    if moving or lower or self._residual(self._gradient(there)) <= 0.9 * least:
                        return fraction, there
            fraction *= 0.5 if fraction > 0.3 else 0.3
        return 0.0, None

    def _outcome(self, response: Response, status: Status, moduli: Array | None = None) -> LoadedState:
        gradient = self._gradient(response) if response.usable else np.full(6, np.inf)
        if moduli is None:
            moduli = np.full((6, 6), np.nan)
        return LoadedState(response, moduli, self._residual(gradient), status, self.evaluations)


def _shortened(step: Array, longest: float) -> Array:
    """A step whose largest component is at most ``longest``."""
    return step * min(1.0, longest / max(float(np.abs(step).max()), 1e-300))


def _admissible(strain: Array) -> bool:
    return bool(min(strain[0], strain[2]) > _SMALLEST_SIDE - 1 and abs(strain[1]) < _LARGEST_SHEAR)

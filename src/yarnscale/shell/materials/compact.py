"""The energy of a homogenized fabric as a small network of one-sided springs.

With x the six strains (s_x, s_a, s_y, II11, II12, II22) over fixed scales,

    a_j = p_j + P_j·x                      steps bend the coordinates of the strain space: a fabric that is pulled
    u_k = q_k + Q_k·x + Σ_j W_kj σ(a_j)    contracts along a curved valley of low energy
    ψ   = c + ½ Σ_i d_i x_i² + Σ_k e_k τ(u_k)²,    d, e ≥ 0

    σ(a) = a/√(1 + a²),    τ(u) = ρ³/(1 + ρ)²,    ρ(u) = ½ (u + √(1 + u²))

Every spring is slack for u ≪ 0 and quadratic for u ≫ 0, as a yarn is before and after it is straight; the slack side
falls like u⁻⁶, so that stiff springs leave soft states alone. ψ is smooth, not below c anywhere, and grows at least
like ½ d·x². Fabrics that are their own mirror image under (s_a, II12) → −(s_a, II12) get the mean of both images. Walls
where the samples end keep states outside from being softer than those at the border: they add f_k max(0, h_k·x − t_k)³
with f ≥ 0.

Only additions, products, divisions and square roots occur, which processors do for many elements at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from types import MappingProxyType
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.shell.materials.friction import Sliders
from yarnscale.shell.materials.material import (
    MaterialKernels,
    ShellMaterial,
    compile_material,
    strains_of_forms,
)

MIRROR = np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0])
"""Signs of the strains of the mirror image of a state."""


class SpringNetwork(NamedTuple):
    """The numbers of the energy, by the names of the module's text; all are dimensionless but energies [J/m²].

    steps P (R, 6), step_offsets p (R,), springs Q (S, 6), bends W (S, R), spring_offsets q (S,), stiffnesses e (S,),
    background d (6,), walls h (B, 6), wall_offsets t (B,), wall_stiffnesses f (B,).
    """

    steps: Array
    step_offsets: Array
    springs: Array
    bends: Array
    spring_offsets: Array
    stiffnesses: Array
    background: Array
    walls: Array
    wall_offsets: Array
    wall_stiffnesses: Array

    @property
    def counts(self) -> tuple[int, int, int]:
        """Numbers of steps, springs and walls."""
        return len(self.step_offsets), len(self.spring_offsets), len(self.wall_offsets)


def images_of(mirrored: bool) -> tuple[Array, ...]:
    """Signs (6,) of the strains of a state and, where its energy is the same, of its mirror image."""
    return (np.ones(6), MIRROR) if mirrored else (np.ones(6),)


def shapes_of(steps: int, springs: int, walls: int) -> SpringNetwork:
    """Shapes of the arrays in place of the arrays."""
    return SpringNetwork(
        *((steps, 6), (steps,), (springs, 6), (springs, steps), (springs,), (springs,), (6,)),
        *((walls, 6), (walls,), (walls,)),
    )  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class CompactMaterial(ShellMaterial):
    """A network of one-sided springs over six strains (see the module's text).

    constant: c [J/m²]. scale: of the strains, (6,) [-, 1/m]; x is the strain over it. springs: the fitted arrays.
    mirrored: whether the energy of a state and of its mirror image are the same. samples: some of the fitted states,
    (m, 6) strains [-, 1/m]; far from all of them the energy is an extrapolation. spacing: distance in x within which a
    state counts as sampled. density: mass per area [kg/m²].
    provenance: plain JSON values. sliders: friction inside the fabric (``shell.materials.friction``); energy, stress
    and moduli are those without it. Raises InputError on arrays that do not match or energies that fall without bound.
    """

    constant: float
    scale: Array
    springs: SpringNetwork
    density: float
    mirrored: bool = True
    samples: Array = field(default_factory=lambda: np.zeros((1, 6)))
    spacing: float = 1.0
    provenance: Mapping[str, object] = field(default_factory=dict)
    sliders: Sliders | None = None

    def __post_init__(self) -> None:
        given = SpringNetwork(*(np.array(array, dtype=np.float64) for array in self.springs))
        object.__setattr__(self, "springs", given)
        counts = given.counts
        for name, array, shape in zip(SpringNetwork._fields, given, shapes_of(*counts), strict=True):
            if array.shape != tuple(shape) or not np.all(np.isfinite(array)):
                raise InputError(name, expected=f"finite numbers of shape {tuple(shape)}", found=array.shape)
        for name in ("stiffnesses", "background", "wall_stiffnesses"):
            if np.any(getattr(given, name) < 0):
                raise InputError(name, expected="no negative number", found=float(getattr(given, name).min()))
        for name, shape in (("scale", (6,)), ("samples", (-1, 6))):
            array = np.array(getattr(self, name), dtype=np.float64)
            if array.ndim != len(shape) or array.shape[-1] != 6 or not np.all(np.isfinite(array)):
                raise InputError(name, expected=f"finite numbers of shape {shape}", found=array.shape)
            object.__setattr__(self, name, array)
        if not np.all(self.scale > 0):
            raise InputError("scale", expected="positive numbers", found=self.scale.tolist())
        for name in ("density", "spacing"):
            if not getattr(self, name) > 0:
                raise InputError(name, expected="a positive number", found=getattr(self, name))
        if self.sliders is not None and self.sliders.bends.shape[1] != counts[0]:
            expected = f"as many columns as the energy has steps, {counts[0]}"
            raise InputError("friction bends", expected=expected, found=self.sliders.bends.shape[1])
        object.__setattr__(self, "provenance", MappingProxyType(dict(self.provenance)))

    @property
    def remembers(self) -> bool:
        """Whether it has sliders."""
        return self.sliders is not None

    @property
    def strain_scale(self) -> Array:
        """``scale``: of bending, a tenth of the curvature of the yarn's surface."""
        return self.scale

    @cached_property
    def constants(self) -> Array:
        """All numbers of the energy, (P, 1), in the order that ``compact_energy`` reads them."""
        numbers = [np.array([self.constant]), 1.0 / self.scale, *(a.ravel() for a in self.springs)]
        return np.concatenate(numbers)[:, None]

    def parameters(self, forms: Array) -> Array:
        return self.constants

    def kernels(self) -> MaterialKernels:
        return _kernels(*self.springs.counts, bool(self.mirrored))

    def outside(self, strains: ArrayLike) -> Array:
        """How far states (..., 6) lie outside the sampled ones: 0 within, 1 another ``spacing`` away."""
        from scipy.spatial import KDTree

        strains = np.asarray(strains, dtype=np.float64)
        places = self.samples / self.scale
        if self.mirrored:
            places = np.concatenate([places, places * MIRROR])
        distance = KDTree(places).query(strains.reshape(-1, 6) / self.scale)[0]
        return np.maximum(distance / self.spacing - 1.0, 0.0).reshape(strains.shape[:-1])


def step(u: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """σ(u) and its two derivatives."""
    inverse = 1 / ca.sqrt(1 + u * u)
    cube = inverse * inverse * inverse
    return u * inverse, cube, -3 * u * cube * inverse * inverse


def spring(u: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """τ(u)² and its two derivatives."""
    root = ca.sqrt(1 + u * u)
    rho, inverse = 0.5 * (u + root), 1 / root
    part = 1 / (1 + rho)
    share, first = rho * part, rho * inverse
    by_rho = share * share * (3 * part + share)
    twice_by_rho = 6 * share * part * part * part
    value, slope = rho * share * share, by_rho * first
    bend = twice_by_rho * first * first + 0.5 * by_rho * inverse * inverse * inverse
    return value * value, 2 * value * slope, 2 * (slope * slope + value * bend)


def wall(u: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """max(0, u)³ and its two derivatives."""
    positive = ca.fmax(u, 0)
    return positive * positive * positive, 3 * positive * positive, 6 * positive


def compact_energy(
    strains: ca.SX, numbers: ca.SX, shapes: SpringNetwork, *, mirrored: bool
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """ψ [J/m²] of the strains (6), its gradient (6) and second derivative (6, 6).

    numbers: ``CompactMaterial.constants``. Derivatives follow the layers, as the energy does: written out by reverse
    differentiation of the scalar graph they would take four times the operations.
    """
    constant, scale, c = network_of(numbers, shapes)
    x = strains * scale
    energy = constant + 0.5 * ca.dot(c.background, x * x)
    gradient, hessian = c.background * x, ca.diag(c.background)
    images = images_of(mirrored)
    for signs in images:
        sign = ca.DM(signs)
        a, b, d = _image(sign * x, c)
        energy += a / len(images)
        gradient += sign * b / len(images)
        hessian += (sign @ sign.T) * d / len(images)
    return energy, scale * gradient, hessian * (scale @ scale.T)


def _image(x: ca.SX, c: Any) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Energy of the springs and walls at x, gradient and second derivative; c: a network of symbols."""
    bent, bent_1, bent_2 = step(c.step_offsets + c.steps @ x)
    psi, psi_1, psi_2 = spring(c.spring_offsets + c.springs @ x + c.bends @ bent)
    psi_1, psi_2 = c.stiffnesses * psi_1, c.stiffnesses * psi_2
    # du/dx, and Σ_k ψ'_k W_kj for the curvature of the steps.
    slope = c.springs + (c.bends * ca.repmat(bent_1.T, c.bends.size1(), 1)) @ c.steps
    curved = (c.bends.T @ psi_1) * bent_2
    energy, gradient = ca.dot(c.stiffnesses, psi), slope.T @ psi_1
    hessian = slope.T @ (ca.repmat(psi_2, 1, 6) * slope) + c.steps.T @ (ca.repmat(curved, 1, 6) * c.steps)
    out, out_1, out_2 = wall(c.walls @ x - c.wall_offsets)
    energy += ca.dot(c.wall_stiffnesses, out)
    gradient += c.walls.T @ (c.wall_stiffnesses * out_1)
    return energy, gradient, hessian + c.walls.T @ (ca.repmat(c.wall_stiffnesses * out_2, 1, 6) * c.walls)


def network_of(numbers: ca.SX, shapes: SpringNetwork) -> tuple[ca.SX, ca.SX, SpringNetwork]:
    """The constant energy, the inverse scale and the network, of symbols."""
    parts, first = [], 0
    for shape in ((1,), (6,), *shapes):
        size = int(np.prod(shape))
        part = numbers[first : first + size]
        # Rows of our arrays lie one behind the other, CasADi's columns do.
        parts.append(ca.reshape(part, shape[1], shape[0]).T if len(shape) == 2 else part)
        first += size
    return parts[0], parts[1], SpringNetwork(*parts[2:])


@cache
def _kernels(steps: int, springs: int, walls: int, mirrored: bool) -> MaterialKernels:
    shapes = shapes_of(steps, springs, walls)
    count = 7 + sum(int(np.prod(shape)) for shape in shapes)

    def energy(forms: ca.SX, numbers: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        return compact_energy(strains_of_forms(forms), numbers, shapes, mirrored=mirrored)

    return compile_material(energy, count, f"compact_{steps}_{springs}", shared=True)

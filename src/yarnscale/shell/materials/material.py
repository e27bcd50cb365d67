"""Shell materials: an energy density of the fundamental forms.

A material writes its energy once, as a symbolic function of the forms (I11, I12, I22, II11, II12, II22) and
of parameters, which all elements share or each has its own. The cloth solver calls the kernels on blocks of elements;
``energy_density``, ``stress`` and ``moduli`` are for other uses.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, fields
from types import MappingProxyType

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.kinematics import COMPONENTS, strain_units
from yarnscale.numerics.kernel import LANES, Kernel, compile_kernel
from yarnscale.shell.materials.spline_patches import PackedSplines

LOWER = tuple((i, j) for i in range(6) for j in range(i + 1))
"""Rows and columns of the 21 entries in which kernels return the 6×6 second derivative."""

_CHUNK = 1024


@dataclass(frozen=True)
class MaterialKernels:
    """Compiled energy density [J/m²] over (forms (6), parameters (P)).

    value: → ψ (1). first: also the gradient by the forms (6). second: also the second derivative (21, order ``LOWER``).
    """

    value: Kernel
    first: Kernel
    second: Kernel


def compile_material(
    energy: Callable[..., ca.SX | tuple[ca.SX, ca.SX, ca.SX]],
    parameter_count: int,
    name: str,
    *,
    shared: bool = False,
    memory_count: int = 0,
) -> MaterialKernels:
    """Kernels of an energy density given as a symbolic function of forms (6) and parameters.

    Where the function returns a tuple, it is ψ with its gradient (6) and second derivative (6, 6) by the strains.
    shared: all elements have the same parameters. memory_count: numbers that each element remembers, a third argument.
    """
    forms, parameters = ca.SX.sym("forms", 6), ca.SX.sym("parameters", parameter_count)
    given = [forms, parameters, *([ca.SX.sym("memory", memory_count)] if memory_count else [])]
    found = energy(*given)
    if isinstance(found, tuple):
        density, gradient, hessian = _by_form(forms, *found)
    else:
        density = found
        hessian, gradient = ca.hessian(density, forms)
    lower = ca.vertcat(*[hessian[i, j] for i, j in LOWER])
    outputs, places = [density, ca.densify(gradient), ca.densify(lower)], (1,) if shared else ()

    def compiled(order: int, suffix: str) -> Kernel:
        function = ca.Function(f"{name}_{suffix}", given, outputs[: order + 1], {"cse": True})
        return compile_kernel(function, function.name(), shared=places)

    return MaterialKernels(compiled(0, "value"), compiled(1, "first"), compiled(2, "second"))


def _by_form(forms: ca.SX, energy: ca.SX, gradient: ca.SX, hessian: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Derivatives by the forms from those by the strains (chain rule of ``strains_of_forms``)."""
    strains, weights = strains_of_forms(forms), ca.SX.sym("weights", 6)
    jacobian = ca.jacobian(strains, forms)
    bent = ca.substitute(ca.hessian(ca.dot(weights, strains), forms)[0], weights, gradient)
    return energy, jacobian.T @ gradient, jacobian.T @ hessian @ jacobian + bent


class ShellMaterial(ABC):
    """Energy density of a thin shell as a function of its first and second fundamental forms."""

    density: float
    """Mass per rest area [kg/m²]."""

    @property
    def strain_scale(self) -> Array:
        """Scale of the strains (6,): that of yarn of 1 mm if the yarn is unknown."""
        return strain_units(1e-3)

    @property
    def remembers(self) -> bool:
        """Whether friction acts in it along a path; energy, stress and moduli here are without friction."""
        return False

    @property
    def packed(self) -> PackedSplines | None:
        """Splines of which every element takes its own pieces for its parameters; None where elements share them."""
        return None

    @abstractmethod
    def parameters(self, forms: Array) -> Array:
        """Parameters of the kernels: (P, 1) that all elements share, or (P, n) of elements with these forms (6, n).

        Forms are rows I11, I12, I22 [-], II11, II12, II22 [1/m]; n is a multiple of LANES; padding columns
        hold some valid state.
        """

    @abstractmethod
    def kernels(self) -> MaterialKernels:
        """Compiled energy and derivatives, the same object for every material of a kind."""

    def remembered(self, count: int) -> tuple[Array, ...]:
        """What kernels take beside forms and parameters, for so many elements: nothing."""
        return ()

    def __reduce__(self) -> tuple[object, ...]:
        """Copy and pickle by fields, since read-only mappings cannot be pickled."""
        values = {entry.name: getattr(self, entry.name) for entry in fields(self) if entry.init}  # type: ignore[arg-type]
        plain = {name: dict(v) if isinstance(v, MappingProxyType) else v for name, v in values.items()}
        return _built, (type(self), plain)

    def energy_density(self, strains: ArrayLike) -> Array:
        """ψ [J/m²], shape (...), of strains (..., 6) in the order of ``kinematics.COMPONENTS``."""
        return self._evaluate(strains, order=0)[0]

    def stress(self, strains: ArrayLike) -> Array:
        """dψ/d(s_x, s_a, s_y, II11, II12, II22), shape (..., 6): in-plane [N/m], bending [N]."""
        return self._evaluate(strains, order=1)[1]

    def moduli(self, strains: ArrayLike) -> Array:
        """Second derivative of ψ by the six strains, shape (..., 6, 6)."""
        return self._evaluate(strains, order=2)[2]

    def form_derivatives(self, strains: ArrayLike) -> tuple[Array, Array, Array]:
        """ψ (n,), its gradient (6, n) and second derivative (21, n, as ``LOWER``) by the forms, of strains (n, 6)."""
        return self._run(checked_strains(strains), order=2)

    def _evaluate(self, strains: ArrayLike, *, order: int) -> tuple[Array, Array, Array]:
        strains = checked_strains(strains)
        flat = strains.reshape(-1, 6)
        energy, stress, moduli = np.empty(len(flat)), np.empty((len(flat), 6)), np.empty((len(flat), 6, 6))
        for start in range(0, len(flat), _CHUNK):
            part = slice(start, start + _CHUNK)
            psi, gradient, lower = self._run(flat[part], order)
            energy[part] = psi
            if order > 0:
                stress[part], moduli[part] = _by_strain(flat[part], gradient, lower)
        lead = strains.shape[:-1]
        return energy.reshape(lead), stress.reshape(*lead, 6), moduli.reshape(*lead, 6, 6)

    def _run(self, strains: Array, order: int) -> tuple[Array, Array, Array]:
        """Energy (n,), gradient (6, n) and lower second derivative (21, n) by the forms."""
        count = len(strains)
        stride = -(-count // LANES) * LANES
        forms = np.zeros((6, stride))
        forms[[0, 2]] = 1.0
        forms[:, :count] = forms_of_strains(strains).T
        parameters = self.parameters(forms)
        psi, gradient, lower = np.empty((1, stride)), np.zeros((6, stride)), np.zeros((21, stride))
        kernels, given = self.kernels(), (forms, parameters, *self.remembered(stride))
        if order == 0:
            kernels.value(stride, stride, *given, psi)
        else:
            kernels.second(stride, stride, *given, psi, gradient, lower)
        return psi[0, :count], gradient[:, :count], lower[:, :count]


def _built(kind: type[ShellMaterial], values: dict[str, object]) -> ShellMaterial:
    return kind(**values)


def checked_strains(strains: ArrayLike) -> Array:
    """Strains (..., 6) as float64; InputError for states that no surface has."""
    array = np.asarray(strains, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != 6:
        raise InputError("strains", expected=f"the 6 components {', '.join(COMPONENTS)}", found=array.shape)
    if not np.all(np.isfinite(array)):
        raise InputError("strains", expected="finite numbers", found="NaN or infinity")
    if np.any(array[..., [0, 2]] <= -1.0) or np.any(np.abs(array[..., 1]) >= 1.0):
        raise InputError("strains", expected="s_x and s_y above -1 and |s_a| < 1", found="a state without area")
    return array


def forms_of_strains(strains: Array) -> Array:
    """(I11, I12, I22, II11, II12, II22) of strains (n, 6), shape (n, 6) (HYLC20 eq. 30)."""
    a, b = 1 + strains[:, 0], 1 + strains[:, 2]
    return np.column_stack([a * a, strains[:, 1] * a * b, b * b, strains[:, 3:]])


def strains_of_forms(forms: ca.SX) -> ca.SX:
    """The six strains of the forms (6), the inverse of ``forms_of_strains``."""
    a, b = ca.sqrt(forms[0]), ca.sqrt(forms[2])
    return ca.vertcat(a - 1, forms[1] / (a * b), b - 1, forms[3:])


def _by_strain(strains: Array, gradient: Array, lower: Array) -> tuple[Array, Array]:
    """Chain rule from derivatives by the forms to derivatives by (s_x, s_a, s_y, II)."""
    n = len(strains)
    a, shear, b = 1 + strains[:, 0], strains[:, 1], 1 + strains[:, 2]
    jacobian = np.zeros((n, 6, 6))
    jacobian[:, 3:, 3:] = np.eye(3)
    jacobian[:, 0, 0] = 2 * a
    jacobian[:, 1, 0], jacobian[:, 1, 1], jacobian[:, 1, 2] = shear * b, a * b, shear * a
    jacobian[:, 2, 2] = 2 * b
    second = np.empty((n, 6, 6))
    for k, (i, j) in enumerate(LOWER):
        second[:, i, j] = second[:, j, i] = lower[k]
    moduli = np.einsum("nki,nkl,nlj->nij", jacobian, second, jacobian, optimize=True)
    moduli[:, 0, 0] += 2 * gradient[0]
    moduli[:, 2, 2] += 2 * gradient[2]
    for (i, j), value in (((0, 1), b), ((1, 2), a), ((0, 2), shear)):
        moduli[:, i, j] += gradient[1] * value
        moduli[:, j, i] += gradient[1] * value
    return np.einsum("kn,nki->ni", gradient, jacobian), moduli

"""An energy written once as a symbolic scalar of a small stencil; values and derivatives are generated kernels."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import casadi as ca
import numpy as np

from yarnscale.numerics.kernel import Kernel, compile_kernel

Symbol = ca.SX


@dataclass(frozen=True)
class LinearTerms:
    """Energy Σ_k inner_k(M_k v): its Hessian Σ M_kᵀ H_k M_k is assembled with that structure.

    Nested, it keeps quadrature sums cheap: derivatives are taken where few variables are left. Each term is a pair of
    a constant matrix (CasADi DM) and a function of the mapped variables that returns a scalar or LinearTerms again.
    """

    terms: Sequence[tuple[ca.DM, Callable[[Symbol], Symbol | LinearTerms]]]


@dataclass(frozen=True)
class Steadied:
    """Energy outer(inner(v)), with a Hessian that leaves out a share of the second derivative of ``outer``.

    Where ``outer`` is concave, as the work of a slider by the square of its way, the exact Hessian is soft along
    motion that the energy soon resists, and Newton's method overshoots; with the whole share left out it never does.
    """

    inner: Symbol
    outer: Callable[[Symbol], Symbol]
    share: float


EnergyFunction = Callable[[Mapping[str, Symbol], Mapping[str, Symbol]], "Symbol | LinearTerms | Steadied"]
_Lower = dict[tuple[int, int], Symbol]


def lower_triangle(size: int) -> list[tuple[int, int]]:
    """Entries (row, column) of a lower triangle in the order kernels write them, row by row."""
    return [(i, j) for i in range(size) for j in range(i + 1)]


@dataclass(frozen=True, eq=False)
class StencilEnergy:
    """A scalar energy of a stencil: named variables, named per-element parameters, one symbolic function.

    variables, parameters: name → number of components, in the order of the columns of a stencil.
    function(variables, parameters): the energy as a CasADi scalar (or ``LinearTerms``, ``Steadied``) of those names.
    """

    name: str
    variables: Mapping[str, int]
    parameters: Mapping[str, int]
    function: EnergyFunction

    @property
    def variable_count(self) -> int:
        """Degrees of freedom of one stencil."""
        return sum(self.variables.values())

    @property
    def parameter_count(self) -> int:
        """Parameters of one stencil."""
        return sum(self.parameters.values())

    def parameter_rows(self, name: str) -> slice:
        """Rows that the named parameter takes in a parameter block."""
        first = 0
        for key, size in self.parameters.items():
            if key == name:
                return slice(first, first + size)
            first += size
        raise KeyError(f"energy '{self.name}' has no parameter '{name}'; it has {', '.join(self.parameters)}")

    @cached_property
    def value(self) -> Kernel:
        """Kernel: variables, parameters → energy."""
        q, p, energy = self._symbolic()
        return self._compile("value", [q, p], [_scalar(energy, q)])

    @cached_property
    def gradient(self) -> Kernel:
        """Kernel: variables, parameters → energy, gradient."""
        q, p, energy = self._symbolic()
        value = _scalar(energy, q)
        return self._compile("gradient", [q, p], [value, ca.gradient(value, q)])

    @cached_property
    def hessian(self) -> Kernel:
        """Kernel: variables, parameters → energy, gradient, lower triangle of the Hessian (row by row)."""
        q, p, energy = self._symbolic()
        value, gradient, hessian = _derivatives(energy, q)
        rows = [hessian.get(entry, ca.SX(0)) for entry in lower_triangle(self.variable_count)]
        return self._compile("hessian", [q, p], [value, gradient, ca.vertcat(*rows)])

    @cache  # noqa: B019 - energies are few and live as long as the process
    def mixed(self, names: tuple[str, ...]) -> Kernel:
        """Kernel: variables, parameters → dE/dp (k), d²E/dq dp (n·k, [i·k + j]), for the named parameters."""
        q, p, energy = self._symbolic()
        value = _scalar(energy, q)
        chosen = np.concatenate([np.arange(p.numel())[self.parameter_rows(name)] for name in names])
        by_parameter = ca.gradient(value, p)[chosen.tolist()]
        mixed = ca.jacobian(by_parameter, q)
        return self._compile("mixed_" + "_".join(names), [q, p], [by_parameter, ca.vec(ca.densify(mixed))])

    def _symbolic(self) -> tuple[Symbol, Symbol, Symbol | LinearTerms | Steadied]:
        q, p = ca.SX.sym("q", self.variable_count), ca.SX.sym("p", self.parameter_count)
        return q, p, self.function(_named(q, self.variables), _named(p, self.parameters))

    def _compile(self, kind: str, inputs: list[Symbol], outputs: list[Symbol]) -> Kernel:
        name = f"{self.name}_{kind}"
        return compile_kernel(ca.Function(name, inputs, [ca.densify(o) for o in outputs], {"cse": True}), name)


def _named(column: Symbol, sizes: Mapping[str, int]) -> dict[str, Symbol]:
    parts, first = {}, 0
    for name, size in sizes.items():
        parts[name] = column[first : first + size]
        first += size
    return parts


def _scalar(energy: Symbol | LinearTerms | Steadied, variables: Symbol) -> Symbol:
    """The energy as one scalar of ``variables``."""
    if isinstance(energy, Steadied):
        return energy.outer(energy.inner)
    if not isinstance(energy, LinearTerms):
        return energy
    total = ca.SX(0)
    for matrix, inner in energy.terms:
        mapped = matrix @ variables
        total += _scalar(inner(mapped), mapped)
    return total


def _derivatives(energy: Symbol | LinearTerms | Steadied, variables: Symbol) -> tuple[Symbol, Symbol, _Lower]:
    """Value, gradient and lower Hessian entries with respect to ``variables`` (a column of plain symbols)."""
    n = variables.numel()
    if not isinstance(energy, LinearTerms):
        value = _scalar(energy, variables)
        hessian, gradient = (
            _steadied(energy, variables) if isinstance(energy, Steadied) else ca.hessian(value, variables)
        )
        entries = {(i, j): hessian[i, j] for i, j in lower_triangle(n) if hessian.sparsity().has_nz(i, j)}
        return value, gradient, entries
    value, gradient, entries = ca.SX(0), ca.SX.zeros(n), {}
    for matrix, inner in energy.terms:
        mapped = ca.SX.sym("u", matrix.size1())
        inner_value, inner_gradient, inner_entries = _derivatives(inner(mapped), mapped)
        symbols = [inner_value, inner_gradient, *inner_entries.values()]
        image = matrix @ variables
        # Putting M v in place of u at every level keeps one graph, whose common parts are then shared.
        inner_value, inner_gradient, *placed = ca.substitute(symbols, [mapped], [image])
        value += inner_value
        gradient += matrix.T @ inner_gradient
        for (row, column), entry in zip(inner_entries, placed, strict=True):
            _accumulate(entries, matrix, row, column, entry)
    return value, gradient, entries


def _steadied(energy: Steadied, variables: Symbol) -> tuple[Symbol, Symbol]:
    """Hessian, without the share that is left out, and gradient."""
    argument = ca.SX.sym("u")
    second, first = ca.hessian(energy.outer(argument), argument)
    second, first = (ca.substitute(part, argument, energy.inner) for part in (second, first))
    hessian, gradient = ca.hessian(energy.inner, variables)
    return first * hessian + (1.0 - energy.share) * second * (gradient @ gradient.T), first * gradient


def _accumulate(entries: _Lower, matrix: ca.DM, row: int, column: int, entry: Symbol) -> None:
    """Add Mᵀ (entry at (row, column) and its mirror) M to the lower triangle ``entries``."""
    left = [(k, float(matrix[row, k])) for k in range(matrix.size2()) if float(matrix[row, k]) != 0.0]
    right = [(k, float(matrix[column, k])) for k in range(matrix.size2()) if float(matrix[column, k]) != 0.0]
    for i, a in left:
        for j, b in right:
            pairs = [(i, j)] if row == column else [(i, j), (j, i)]
            for target in pairs:
                if target[0] >= target[1]:
                    entries[target] = entries.get(target, ca.SX(0)) + (a * b) * entry

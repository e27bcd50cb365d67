"""Derivatives of a compact energy by its own numbers, for many states at once.

What is fitted of a state are its energy, its slopes along six directions and its second derivatives along them. Along
a direction v, value, slope and second derivative go through the layers of ``shell.materials.compact`` together:

    a, a' = P v                      →  h = σ(a), h' = σ' a', h'' = σ'' a'²
    u, u' = Q v + W h', u'' = W h''  →  ψ, ψ' u', ψ'' u'² + ψ' u''

and their derivatives by the numbers follow in reverse. The loops are compiled and run over the springs, which lie one
behind the other in memory: array by array, these passes take five times as long.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np

from yarnscale.arrays import Array
from yarnscale.shell.materials.compact import SpringNetwork, images_of, shapes_of

OUTPUTS = 13
"""Per state: energy, six slopes, six second derivatives."""
_LEAST = 1e-12
"""Stiffness [J/m²] of which there is a logarithm."""
_JIT: dict[str, Any] = {
    "cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"nsz", "arcp", "contract", "reassoc"},
}  # fmt: skip


def sizes_of(steps: int, springs: int) -> list[int]:
    """Lengths of the parts of a vector of unknowns: P, p, Qᵀ, Wᵀ, q, log e, log d, c."""
    shapes = shapes_of(steps, springs, 0)[:7]
    return [int(np.prod(shape)) for shape in shapes] + [1]


def unknowns_of(springs: SpringNetwork, constant: float) -> Array:
    """The vector of unknowns of a network without walls."""
    positive = (np.log(np.maximum(part, _LEAST)) for part in (springs.stiffnesses, springs.background))
    parts = [*springs[:2], springs.springs.T, springs.bends.T, springs.spring_offsets, *positive, [constant]]
    return np.concatenate([np.ravel(part) for part in parts])


def springs_of(unknowns: Array, steps: int, springs: int) -> tuple[SpringNetwork, float]:
    """The network without walls, and its constant."""
    parts = np.split(unknowns, np.cumsum(sizes_of(steps, springs))[:-1])
    first, offsets, directions, bends, thresholds, stiffnesses, background, constant = parts
    network = SpringNetwork(
        first.reshape(steps, 6), offsets, directions.reshape(6, springs).T, bends.reshape(steps, springs).T, thresholds,
        np.exp(stiffnesses), np.exp(background), np.zeros((0, 6)), np.zeros(0), np.zeros(0),
    )  # fmt: skip
    return network, float(constant[0])


class Directional:
    """Energies, slopes and second derivatives at states x (6, n) along six directions each (6, directions 6, n).

    mirrored: the mean of both mirror images. Numbers are of the precision of x.
    """

    def __init__(self, x: Array, directions: Array, *, mirrored: bool) -> None:
        # Of one layout, for which loops are compiled once.
        self.x, self.directions = np.ascontiguousarray(x), np.ascontiguousarray(directions)
        self.signs = np.array(images_of(mirrored), dtype=x.dtype)

    def part(self, states: slice) -> Directional:
        """Some of the states."""
        return Directional(self.x[:, states], self.directions[:, :, states], mirrored=len(self.signs) == 2)

    def values(self, springs: SpringNetwork, constant: float) -> Array:
        """(13, n)."""
        background = np.append(springs.background, constant).astype(self.x.dtype)
        return self._outputs(springs).sum(axis=0) + np.einsum("k,kon->on", background, self.by_background())

    def by_stiffness(self, springs: SpringNetwork) -> Array:
        """Outputs of the springs if their stiffness were one, (S, 13, n)."""
        return self._outputs(springs._replace(stiffnesses=np.ones_like(springs.stiffnesses)))

    def _outputs(self, springs: SpringNetwork) -> Array:
        result = np.zeros((len(springs.stiffnesses), OUTPUTS, self.x.shape[1]), self.x.dtype)
        _add_outputs(self.x, self.directions, self.signs, _rows(springs, self.x.dtype), result)
        return result

    def by_background(self) -> Array:
        """Outputs of the background's unit stiffnesses and of a constant, (7, 13, n)."""
        x, v = self.x, self.directions
        result = np.zeros((7, OUTPUTS, x.shape[1]), x.dtype)
        result[:6, 0], result[6, 0] = 0.5 * x * x, 1.0
        result[:6, 1:7], result[:6, 7:] = v * x[:, None], v * v
        return result

    def jacobian(self, springs: SpringNetwork) -> Array:
        """Derivatives of ``values`` by the unknowns, (n, 13, unknowns)."""
        network, tail = _rows(springs, self.x.dtype), self.by_background()
        tail[:6] *= springs.background[:, None, None]
        result = np.zeros((self.x.shape[1], OUTPUTS, sum(sizes_of(*network.bends.shape))), self.x.dtype)
        result[..., -7:] = tail.T
        _add_jacobian(self.x, self.directions, self.signs, network, result)
        return result

    def pulled_back(self, springs: SpringNetwork, adjoint: Array) -> Array:
        """Derivative of the sum of adjoint (13, n) times ``values`` by the unknowns, (unknowns,)."""
        network, tail = _rows(springs, self.x.dtype), np.tensordot(self.by_background(), adjoint, 2)
        tail[:6] *= springs.background
        result = np.zeros(sum(sizes_of(*network.bends.shape)), self.x.dtype)
        result[-7:] = tail
        _add_pulled_back(self.x, self.directions, self.signs, network, np.ascontiguousarray(adjoint), result)
        return result


def _rows(springs: SpringNetwork, kind: Any) -> SpringNetwork:
    """Of one precision; ``springs`` (6, S) and ``bends`` (R, S) transposed."""
    turned = springs._replace(springs=springs.springs.T, bends=springs.bends.T)
    return SpringNetwork(*(np.ascontiguousarray(part, kind) for part in turned))


class _Layers(NamedTuple):
    """Of one state: σ and three derivatives (4, R); a', h', h'' (6, R); ψ and three derivatives (4, S); u', u''."""

    sigma: Array
    a1: Array
    h1: Array
    h2: Array
    psi: Array
    u1: Array
    u2: Array


@numba.njit(**_JIT)
def _room(kind, steps, springs):
    return _Layers(
        np.empty((4, steps), kind), np.empty((6, steps), kind), np.empty((6, steps), kind), np.empty((6, steps), kind),
        np.empty((4, springs), kind), np.empty((6, springs), kind), np.empty((6, springs), kind),
    )  # fmt: skip


@numba.njit(**_JIT)
def _forward(x, v, network, layers):
    """Fill the layers at x (6) along v (6, directions 6)."""
    sigma, a1, h1, h2, psi, u1, u2 = layers
    steps, springs = network.bends.shape
    u = psi[0]
    u1[:], u2[:] = 0.0, 0.0
    for k in range(springs):  # numba compiles an array's assignment with all that its error may say
        u[k] = network.spring_offsets[k]
    for i in range(6):
        for k in range(springs):
            u[k] += network.springs[i, k] * x[i]
        for d in range(6):
            for k in range(springs):
                u1[d, k] += network.springs[i, k] * v[i, d]
    for j in range(steps):
        a = network.step_offsets[j]
        for i in range(6):
            a += network.steps[j, i] * x[i]
        inverse = 1.0 / np.sqrt(1.0 + a * a)
        square = inverse * inverse
        cube = inverse * square
        sigma[0, j], sigma[1, j], sigma[2, j] = a * inverse, cube, -3.0 * a * cube * square
        sigma[3, j] = (12.0 * a * a - 3.0) * cube * square * square
        for k in range(springs):
            u[k] += network.bends[j, k] * sigma[0, j]
        for d in range(6):
            slope = network.steps[j, 0] * v[0, d]
            for i in range(1, 6):
                slope += network.steps[j, i] * v[i, d]
            a1[d, j] = slope
            h1[d, j], h2[d, j] = sigma[1, j] * slope, sigma[2, j] * slope * slope
            for k in range(springs):
                u1[d, k] += network.bends[j, k] * h1[d, j]
                u2[d, k] += network.bends[j, k] * h2[d, j]
    for k in range(springs):
        root = np.sqrt(1.0 + u[k] * u[k])
        inverse = 1.0 / root
        # ρ without cancellation for u far below zero.
        rho = 0.5 * (u[k] + root) if u[k] > 0 else 0.5 / (root - u[k])
        b, c = rho * inverse, 0.5 * inverse * inverse * inverse
        d3 = -3.0 * u[k] * c * inverse * inverse
        part = 1.0 / (1.0 + rho)
        share, square = rho * part, part * part
        f1 = share * share * (3.0 * part + share)
        f2, f3 = 6.0 * share * square * part, 6.0 * (part - 3.0 * share) * square * square
        r, r1 = rho * share * share, f1 * b
        r2, r3 = f2 * b * b + f1 * c, (f3 * b * b + 3.0 * f2 * c) * b + f1 * d3
        e = network.stiffnesses[k]
        psi[0, k], psi[1, k] = e * r * r, 2.0 * e * r * r1
        psi[2, k], psi[3, k] = 2.0 * e * (r1 * r1 + r * r2), 2.0 * e * (3.0 * r1 * r2 + r * r3)


@numba.njit(**_JIT)
def _state(x, v, signs, number, image, here, along):
    """Copy one image of a state."""
    for i in range(6):
        here[i] = signs[image, i] * x[i, number]
        for d in range(6):
            along[i, d] = signs[image, i] * v[i, d, number]


@numba.njit(**_JIT)
def _add_outputs(x, v, signs, network, result):
    here, along, share = np.empty(6, x.dtype), np.empty((6, 6), x.dtype), 1.0 / len(signs)
    layers = _room(x.dtype, *network.bends.shape)
    psi, u1, u2 = layers.psi, layers.u1, layers.u2
    for number in range(x.shape[1]):
        for image in range(len(signs)):
            _state(x, v, signs, number, image, here, along)
            _forward(here, along, network, layers)
            for k in range(psi.shape[1]):
                result[k, 0, number] += share * psi[0, k]
                for d in range(6):
                    result[k, 1 + d, number] += share * psi[1, k] * u1[d, k]
                    result[k, 7 + d, number] += share * (psi[2, k] * u1[d, k] * u1[d, k] + psi[1, k] * u2[d, k])


@numba.njit(**_JIT)
def _back(x, v, directions, network, layers, by_u, by_u1, by_u2, row):
    """Add to a row of the unknowns the derivatives of Σ by_u·u + by_u1·u' + by_u2·u'' of some directions."""
    sigma, a1, h1, h2 = layers.sigma, layers.a1, layers.h1, layers.h2
    steps, springs = network.bends.shape
    first, second = 7 * steps, 7 * steps + 6 * springs
    for j in range(steps):
        w, by_w = network.bends[j], row[second + j * springs : second + (j + 1) * springs]
        by_h = 0.0
        for k in range(springs):
            by_h += w[k] * by_u[k]
            by_w[k] += by_u[k] * sigma[0, j]
        by_a = by_h * sigma[1, j]
        for d in directions:
            by_h1 = by_h2 = 0.0
            for k in range(springs):
                by_h1 += w[k] * by_u1[d, k]
                by_h2 += w[k] * by_u2[d, k]
                by_w[k] += by_u1[d, k] * h1[d, j] + by_u2[d, k] * h2[d, j]
            by_a += (by_h1 * sigma[2, j] + by_h2 * sigma[3, j] * a1[d, j]) * a1[d, j]
            by_a1 = by_h1 * sigma[1, j] + 2.0 * by_h2 * sigma[2, j] * a1[d, j]
            for i in range(6):
                row[6 * j + i] += by_a1 * v[i, d]
        row[6 * steps + j] += by_a
        for i in range(6):
            row[6 * j + i] += by_a * x[i]
    for i in range(6):
        by_q = row[first + i * springs : first + (i + 1) * springs]
        for k in range(springs):
            by_q[k] += by_u[k] * x[i]
        for d in directions:
            for k in range(springs):
                by_q[k] += by_u1[d, k] * v[i, d]
    last = second + steps * springs
    for k in range(springs):
        row[last + k] += by_u[k]


@numba.njit(**_JIT)
def _add_pulled_back(x, v, signs, network, adjoint, row):
    here, along, share = np.empty(6, x.dtype), np.empty((6, 6), x.dtype), 1.0 / len(signs)
    layers = _room(x.dtype, *network.bends.shape)
    psi, u1, u2 = layers.psi, layers.u1, layers.u2
    springs, steps = psi.shape[1], len(network.step_offsets)
    by_u, by_u1, by_u2 = np.empty(springs, x.dtype), np.empty_like(u1), np.empty_like(u2)
    by_stiffness = row[7 * steps + (7 + steps) * springs :]
    for number in range(x.shape[1]):
        for image in range(len(signs)):
            _state(x, v, signs, number, image, here, along)
            _forward(here, along, network, layers)
            energy = share * adjoint[0, number]
            for k in range(springs):
                by_u[k] = energy * psi[1, k]
                by_stiffness[k] += energy * psi[0, k]
            for d in range(6):
                slope, second = share * adjoint[1 + d, number], share * adjoint[7 + d, number]
                for k in range(springs):
                    once, twice = slope * u1[d, k] + second * u2[d, k], second * u1[d, k] * u1[d, k]
                    by_u[k] += psi[2, k] * once + psi[3, k] * twice
                    by_u1[d, k] = slope * psi[1, k] + 2.0 * second * psi[2, k] * u1[d, k]
                    by_u2[d, k] = second * psi[1, k]
                    by_stiffness[k] += psi[1, k] * once + psi[2, k] * twice
            _back(here, along, range(6), network, layers, by_u, by_u1, by_u2, row)


@numba.njit(**_JIT)
def _add_jacobian(x, v, signs, network, rows):
    here, along, share = np.empty(6, x.dtype), np.empty((6, 6), x.dtype), 1.0 / len(signs)
    layers = _room(x.dtype, *network.bends.shape)
    psi, u1, u2 = layers.psi, layers.u1, layers.u2
    springs, steps = psi.shape[1], len(network.step_offsets)
    by_u, by_u1, by_u2 = np.empty(springs, x.dtype), np.zeros_like(u1), np.zeros_like(u2)
    place = 7 * steps + (7 + steps) * springs
    for number in range(x.shape[1]):
        for image in range(len(signs)):
            _state(x, v, signs, number, image, here, along)
            _forward(here, along, network, layers)
            psi *= share
            for k in range(springs):
                by_u[k] = psi[1, k]
                rows[number, 0, place + k] += psi[0, k]
            _back(here, along, range(0), network, layers, by_u, by_u1, by_u2, rows[number, 0])
            for d in range(6):
                for k in range(springs):
                    by_u[k], by_u1[d, k], by_u2[d, k] = psi[2, k] * u1[d, k], psi[1, k], 0.0
                    rows[number, 1 + d, place + k] += psi[1, k] * u1[d, k]
                _back(here, along, range(d, d + 1), network, layers, by_u, by_u1, by_u2, rows[number, 1 + d])
                for k in range(springs):
                    square = u1[d, k] * u1[d, k]
                    by_u[k] = psi[3, k] * square + psi[2, k] * u2[d, k]
                    by_u1[d, k], by_u2[d, k] = 2.0 * psi[2, k] * u1[d, k], psi[1, k]
                    rows[number, 7 + d, place + k] += psi[2, k] * square + psi[1, k] * u2[d, k]
                _back(here, along, range(d, d + 1), network, layers, by_u, by_u1, by_u2, rows[number, 7 + d])

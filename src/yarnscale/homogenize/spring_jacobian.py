"""Derivatives of a compact energy by its own numbers, for many states at once.

What is fitted of a state are its energy, its slopes along six directions and its second derivatives along them. Along
a direction v, value, slope and second derivative go through the layers of ``shell.materials.compact`` together:

    a, a' = P v                      →  h = σ(a), h' = σ' a', h'' = σ'' a'²
    u, u' = Q v + W h', u'' = W h''  →  ψ, ψ' u', ψ'' u'² + ψ' u''

and their derivatives by the numbers follow in reverse. States are the last axis of all arrays, so that loops run along
memory.
"""

from __future__ import annotations

import numpy as np

from yarnscale.arrays import Array
from yarnscale.shell.materials.compact import MIRROR, SpringNetwork, shapes_of

OUTPUTS = 13
"""Per state: energy, six slopes, six second derivatives."""
_LEAST = 1e-12
"""Stiffness [J/m²] of which there is a logarithm."""


def sizes_of(steps: int, springs: int) -> list[int]:
    """Lengths of the parts of a vector of unknowns: P, p, Q, W, q, log e, log d, c."""
    shapes = shapes_of(steps, springs, 0)[:7]
    return [int(np.prod(shape)) for shape in shapes] + [1]


def unknowns_of(springs: SpringNetwork, constant: float) -> Array:
    """The vector of unknowns of a network without walls."""
    positive = (np.log(np.maximum(part, _LEAST)) for part in (springs.stiffnesses, springs.background))
    parts = [*springs[:5], *positive, [constant]]
    return np.concatenate([np.ravel(part) for part in parts])


def springs_of(unknowns: Array, steps: int, springs: int) -> tuple[SpringNetwork, float]:
    """The network without walls, and its constant."""
    parts = np.split(unknowns, np.cumsum(sizes_of(steps, springs))[:-1])
    shapes = shapes_of(steps, springs, 0)
    first, offsets, directions, bends, thresholds, stiffnesses, background = (
        part.reshape(tuple(shape)) for part, shape in zip(parts[:7], shapes[:7], strict=True)
    )
    network = SpringNetwork(
        first, offsets, directions, bends, thresholds, np.exp(stiffnesses), np.exp(background),
        np.zeros((0, 6)), np.zeros(0), np.zeros(0),
    )  # fmt: skip
    return network, float(parts[7][0])


class Directional:
    """Energies, slopes and second derivatives at states x (6, n) along six directions each (6, directions 6, n).

    mirrored: the mean of both mirror images. Numbers are of the precision of x and of the springs.
    """

    def __init__(self, x: Array, directions: Array, *, mirrored: bool) -> None:
        signs = [sign.astype(x.dtype) for sign in ((np.ones(6), MIRROR) if mirrored else (np.ones(6),))]
        self.images = [(x * sign[:, None], directions * sign[:, None, None]) for sign in signs]

    def part(self, states: slice) -> Directional:
        """Some of the states."""
        found = object.__new__(Directional)
        found.images = [(x[:, states], v[:, :, states]) for x, v in self.images]
        return found

    def values(self, springs: SpringNetwork, constant: float) -> Array:
        """(13, n)."""
        layers = np.mean([_Pass(x, v, springs).outputs().sum(axis=0) for x, v in self.images], axis=0)
        return layers + np.tensordot(np.append(springs.background, constant), self.by_background(), 1)

    def by_stiffness(self, springs: SpringNetwork) -> Array:
        """Outputs of the springs if their stiffness were one, (S, 13, n)."""
        alone = springs._replace(stiffnesses=np.ones_like(springs.stiffnesses))
        return np.mean([_Pass(x, v, alone).outputs() for x, v in self.images], axis=0)

    def by_background(self) -> Array:
        """Outputs of the background's unit stiffnesses and of a constant, (7, 13, n)."""
        x, v = self.images[0]
        result = np.zeros((7, OUTPUTS, x.shape[1]), x.dtype)
        result[:6, 0], result[6, 0] = 0.5 * x * x, 1.0
        result[:6, 1:7], result[:6, 7:] = v * x[:, None], v * v
        return result

    def jacobian(self, springs: SpringNetwork) -> Array:
        """Derivatives of ``values`` by the unknowns, (unknowns, 13, n)."""
        found = [_Pass(x, v, springs).jacobian() for x, v in self.images]
        layers = found[0] if len(found) == 1 else 0.5 * (found[0] + found[1])
        tail = self.by_background()
        tail[:6] *= springs.background[:, None, None]
        return np.concatenate([layers, tail])

    def pulled_back(self, springs: SpringNetwork, adjoint: Array) -> Array:
        """Derivative of the sum of adjoint (13, n) times ``values`` by the unknowns, (unknowns,)."""
        layers = np.mean([_Pass(x, v, springs).pulled_back(adjoint) for x, v in self.images], axis=0)
        tail = np.tensordot(self.by_background(), adjoint, 2)
        tail[:6] *= springs.background
        return np.concatenate([layers, tail])


class _Pass:
    """One image of some states through the layers."""

    def __init__(self, x: Array, v: Array, springs: SpringNetwork) -> None:
        self.x, self.v, self.springs = x, v, springs
        self.sigma = step(springs.steps @ x + springs.step_offsets[:, None])
        self.a1 = np.tensordot(springs.steps, v, 1)
        self.h1, self.h2 = self.sigma[1][:, None] * self.a1, self.sigma[2][:, None] * self.a1 * self.a1
        u = springs.springs @ x + springs.spring_offsets[:, None] + springs.bends @ self.sigma[0]
        self.psi = [springs.stiffnesses[:, None] * part for part in _spring(u)]
        self.u1 = np.tensordot(springs.springs, v, 1) + np.tensordot(springs.bends, self.h1, 1)
        self.u2 = np.tensordot(springs.bends, self.h2, 1)

    def outputs(self) -> Array:
        """Of every spring, (S, 13, n)."""
        psi, psi1, psi2 = (part[:, None] for part in self.psi[:3])
        return np.concatenate([psi, psi1 * self.u1, psi2 * self.u1 * self.u1 + psi1 * self.u2], axis=1)

    def jacobian(self) -> Array:
        """By P, p, Q, W, q, log e: (..., 13, n)."""
        bends = self.springs.bends.T
        psi1, psi2, psi3 = (part[:, None] for part in self.psi[1:])
        sigma, sigma1, sigma2, sigma3 = (part[:, None] for part in self.sigma)
        # Adjoints of u, of u' (slopes and second derivatives) and of u'' (second derivatives).
        by_u = np.concatenate([psi1, psi2 * self.u1, psi3 * self.u1 * self.u1 + psi2 * self.u2], axis=1)
        by_u1 = np.concatenate([np.repeat(psi1, 6, axis=1), 2 * psi2 * self.u1], axis=1)
        by_h, by_h1, by_h2 = (np.tensordot(bends, part, 1) for part in (by_u, by_u1, psi1))
        by_a, by_a1 = by_h * sigma1, by_h1 * sigma1
        by_a[:, 1:] += by_h1 * sigma2 * np.tile(self.a1, (1, 2, 1))
        by_a[:, 7:] += by_h2 * sigma3 * self.a1 * self.a1
        by_a1[:, 6:] += 2 * by_h2 * sigma2 * self.a1
        x, v, h1 = self.x[:, None], np.tile(self.v, (1, 2, 1)), np.tile(self.h1, (1, 2, 1))
        through = _outer(by_u, sigma, by_u1, h1)
        through[:, :, 7:] += psi1[:, None] * self.h2
        parts = (
            _outer(by_a, x, by_a1, v), by_a, _outer(by_u, x, by_u1, v), through, by_u, self.outputs(),
        )  # fmt: skip
        return np.concatenate([part.reshape(-1, OUTPUTS, self.x.shape[1]) for part in parts])

    def pulled_back(self, adjoint: Array) -> Array:
        """``jacobian`` summed with adjoint (13, n)."""
        bends, (energy, slopes, seconds) = self.springs.bends.T, np.split(adjoint, [1, 7])
        psi, psi1, psi2, psi3 = self.psi
        sigma, sigma1, sigma2, sigma3 = self.sigma
        once = (self.u1 * slopes + self.u2 * seconds).sum(axis=1)
        twice = (self.u1 * self.u1 * seconds).sum(axis=1)
        by_stiffness = psi * energy + psi1 * once + psi2 * twice
        by_u = psi1 * energy + psi2 * once + psi3 * twice
        by_u1 = psi1[:, None] * slopes + 2 * psi2[:, None] * self.u1 * seconds
        by_h1, by_h2 = np.tensordot(bends, by_u1, 1), bends @ psi1
        by_a = bends @ by_u * sigma1 + sigma2 * (by_h1 * self.a1).sum(axis=1)
        by_a += sigma3 * by_h2 * (self.a1 * self.a1 * seconds).sum(axis=1)
        by_a1 = by_h1 * sigma1[:, None] + 2 * (by_h2 * sigma2)[:, None] * self.a1 * seconds
        through = by_u @ sigma.T + _paired(by_u1, self.h1) + psi1 @ (self.h2 * seconds).sum(axis=1).T
        parts = (
            by_a @ self.x.T + _paired(by_a1, self.v), by_a.sum(axis=1),
            by_u @ self.x.T + _paired(by_u1, self.v), through, by_u.sum(axis=1), by_stiffness.sum(axis=1),
        )  # fmt: skip
        return np.concatenate([part.ravel() for part in parts])


def _paired(a: Array, b: Array) -> Array:
    """Sums over directions and states, (rows of a, rows of b)."""
    return np.tensordot(a, b, ((1, 2), (1, 2)))


def _outer(by_value: Array, value: Array, by_slope: Array, slope: Array) -> Array:
    """Derivatives by a matrix M of values M·value and slopes M·slope, (rows, columns, 13, n)."""
    result = by_value[:, None] * value
    result[:, :, 1:] += by_slope[:, None] * slope
    return result


def step(u: Array) -> list[Array]:
    """σ(u) and three derivatives."""
    # Products, since powers of arrays take ten times as long.
    inverse = 1.0 / np.sqrt(1.0 + u * u)
    square = inverse * inverse
    cube = inverse * square
    slope = -3.0 * u * cube * square
    return [u * inverse, cube, slope, (12.0 * u * u - 3.0) * cube * square * square]


def _spring(u: Array) -> list[Array]:
    """τ(u)² and three derivatives."""
    root = np.sqrt(1.0 + u * u)
    inverse = 1.0 / root
    # ρ without cancellation for u far below zero.
    rho = np.where(u > 0, 0.5 * (u + root), 0.5 / (root - np.minimum(u, 0.0)))
    b, c = rho * inverse, 0.5 * inverse * inverse * inverse
    d = -3.0 * u * c * inverse * inverse
    part = 1.0 / (1.0 + rho)
    share, square = rho * part, part * part
    f1 = share * share * (3 * part + share)
    f2, f3 = 6 * share * square * part, 6 * (part - 3 * share) * square * square
    r, r1 = rho * share * share, f1 * b
    r2, r3 = f2 * b * b + f1 * c, (f3 * b * b + 3 * f2 * c) * b + f1 * d
    return [r * r, 2 * r * r1, 2 * (r1 * r1 + r * r2), 2 * (3 * r1 * r2 + r * r3)]

"""The stretch test simulated: a swatch between two clamps, pulled apart step by step (EST22 §4.3 and 5.1).

The swatch stays in its plane. The clamps forbid any motion across, so the stress is not uniform, and least so in
swatches that are short and wide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.errors import InputError, positive
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.materials.orthotropic import DirectionalMaterial
from yarnscale.shell.mesh import TriangleMesh, rectangle
from yarnscale.swatches.held_shell import HeldEquilibrium, HeldShell, Measure
from yarnscale.swatches.measurements import LENGTH, Direction

ELEMENTS_ACROSS = 10
"""Spacing of the mesh: this part of the shorter side."""
_HALVINGS = 4
"""How often a step to the next stretch is halved when it fails."""


@dataclass(frozen=True, eq=False)
class StretchResponse:
    """A swatch at several stretches; arrays (n,).

    width: of the swatch at rest [m]. force: of a clamp [N]; contraction: over the gauge width at the middle; converged:
    which states are equilibria. positions: (n, nv, 3) [m].
    """

    width: float

    stretch: Array
    force: Array
    contraction: Array
    converged: Flags
    positions: Array


class StretchSwatch:
    """A swatch between clamps.

    direction: of the fabric, along which it is pulled. length: between the clamps, width: [m]. gauge_width: material
    width at the middle over which contraction is measured [m], None for all. elements: along the shorter side.
    clamped: whether clamps forbid motion across (False: a uniform strip, to check against closed forms).
    """

    def __init__(
        self, direction: Direction, length: float = 0.10, width: float = 0.06, *, gauge_width: float | None = None,
        elements: int = ELEMENTS_ACROSS, clamped: bool = True,
    ) -> None:  # fmt: skip
        for name, value in (("length", length), ("width", width)):
            positive(f"swatch {name}", value, LENGTH)
        if gauge_width is not None and not 0 < gauge_width <= width * (1 + 1e-9):
            raise InputError("gauge width", expected=f"at most the width {width:g} m", found=gauge_width)
        self.direction, self.length, self.width = direction, length, width
        self.gauge_width = min(gauge_width or width, width)
        self.mesh = swatch_mesh(length, width, direction, elements)
        panel = self.mesh.panel
        ends = np.abs(np.abs(panel[:, 0]) - length / 2) < 1e-9 * length
        free = np.ones((len(panel), 3), bool)
        free[:, 2] = False
        free[ends, 0] = False
        if clamped:
            free[ends, 1] = False
        else:
            free[self.mesh.nearest_vertex((0.0, 0.0)), 1] = False
        self.shell = HeldShell(self.mesh, free)
        self._pulled = panel[:, 0] > length / 2 * (1 - 1e-9)
        self._gauge = self._gauge_weights()

    def respond(
        self, material: ShellMaterial, stretches: Sequence[float] | Array, *, near: StretchResponse | None = None
    ) -> StretchResponse:
        """Force and contraction at rising stretches; ``near``: these stretches of a similar material, to start from."""
        stretches = np.asarray(stretches, np.float64)
        if stretches.ndim != 1 or not len(stretches) or not (np.diff(stretches, prepend=0.0) > 0).all():
            raise InputError("stretches", expected="rising numbers above zero", found=stretches)
        rest = np.column_stack([self.mesh.panel, np.zeros(self.mesh.vertex_count)])
        positions, converged = np.empty((len(stretches), *rest.shape)), np.zeros(len(stretches), bool)
        last, last_stretch = rest, 0.0
        for k, stretch in enumerate(stretches):
            found = None
            if near is not None and near.converged[k]:
                found = self.shell.solve(material, near.positions[k])
            if found is None or not found.converged:
                found = self._step(material, rest, last, last_stretch, float(stretch))
            positions[k], converged[k] = found.positions, found.converged
            if found.converged:
                last, last_stretch = found.positions, float(stretch)
        values = [[m.value for m in self.measures(material, positions[k])] for k in range(len(stretches))]
        force, contraction = np.array(values).T
        return StretchResponse(self.width, stretches, force, contraction, converged, positions)

    def measures(self, material: ShellMaterial, positions: Array) -> tuple[Measure, Measure]:
        """Force of a clamp [N] and contraction at positions (nv, 3)."""
        pulled = np.zeros_like(positions)
        pulled[self._pulled, 0] = 1.0
        force = float(self.shell.forces(material, positions)[self._pulled, 0].sum())
        contraction = 1.0 - float(np.vdot(self._gauge, positions)) / self.gauge_width
        nothing = np.zeros_like(positions)
        return Measure(force, nothing, pulled), Measure(contraction, -self._gauge / self.gauge_width)

    def derivatives(self, material: DirectionalMaterial, response: StretchResponse, constants: Sequence[str]) -> Array:
        """d(force [N], contraction)/d(constants), shape (n, 2, constants); NaN for states that did not converge."""
        states = zip(response.positions, response.converged, strict=True)
        return self.shell.derivatives_of(material, states, lambda x: self.measures(material, x), constants)

    def _step(
        self, material: ShellMaterial, rest: Array, last: Array, last_stretch: float, stretch: float
    ) -> HeldEquilibrium:
        """From one stretch to the next, in smaller steps where Newton fails; the displacement grows in proportion."""
        target = stretch
        for _ in range(_HALVINGS + 1):
            found = self.shell.solve(material, self._scaled(rest, last, last_stretch, target))
            if found.converged and target == stretch:
                return found
            if found.converged:
                last, last_stretch, target = found.positions, target, stretch
            else:
                target = 0.5 * (last_stretch + target)
        return self.shell.solve(material, self._scaled(rest, last, last_stretch, stretch))

    def _scaled(self, rest: Array, last: Array, last_stretch: float, stretch: float) -> Array:
        start = rest.copy()
        if last_stretch > 0:
            start += (last - rest) * (stretch / last_stretch)
        else:
            start[:, 0] *= 1.0 + stretch
        return start

    def _gauge_weights(self) -> Array:
        """Weights of the positions, (nv, 3), that give the distance across of the two ends of the gauge."""
        weights = np.zeros((self.mesh.vertex_count, 3))
        for side in (1.0, -1.0):
            corners, share = _inside(self.mesh, np.array([0.0, side * self.gauge_width / 2]))
            weights[corners, 1] += side * share
        return weights


def swatch_mesh(length: float, width: float, direction: Direction, elements: int) -> TriangleMesh:
    """Rectangle with x along the swatch, cut along a direction of the fabric, the same from all four sides."""
    spacing = min(length, width) / elements
    columns = 2 * max(1, round(length / spacing / 2))
    return rectangle(length, width, length / columns, grain=direction.angle)


def _inside(mesh: TriangleMesh, point: Array) -> tuple[Integers, Array]:
    """Corners of the triangle around a point of the panel, and their barycentric weights (3,)."""
    corners = mesh.panel[mesh.triangles]
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    inner = np.linalg.solve(edges, (point - corners[:, 0])[:, :, None])[:, :, 0]
    shares = np.column_stack([1 - inner.sum(axis=1), inner])
    best = int(np.argmax(shares.min(axis=1)))
    return mesh.triangles[best], shares[best]

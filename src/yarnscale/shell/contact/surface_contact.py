"""Contact of cloth with itself and with bodies of triangles.

Energy Σ w b(d) over pairs of a vertex and a triangle and over pairs of edges, the latter times a factor that vanishes
for parallel edges (Li et al. 2020, sections 4 and 5). The weights w are areas such that the pressure between
surfaces does not depend on the mesh, see ``pair_search``. Frames are tested for crossings by a search of their own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from yarnscale.motion.obstacles import TriangleObstacle
from yarnscale.numerics.threads import run_parts
from yarnscale.shell.contact import pair_hessian, pair_loops
from yarnscale.shell.contact.barrier import ContactSettings, barrier, smooth_length
from yarnscale.shell.contact.crossings import CLOTH, Crossing, crossing_triangles, surface_crossings
from yarnscale.shell.contact.pair_search import Pairs, PairSearch, shares
from yarnscale.shell.contact.stick import begun_with, ended_with
from yarnscale.shell.mesh import TriangleMesh
from yarnscale.shell.state import Slips

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_KEPT = 0.1
"""Part of a distance that remains after a step."""


@dataclass(frozen=True, eq=False)
class _Grip:
    """Friction contacts of a step: pairs (k, 4), coefficients (k, 4), normals (k, 3), largest friction (k,) [N].

    origin: all vertices at its start (nv, 3) [m]; reach: slip of full friction [m]; begun: elastic slip at the start
    (k, 3) [m]; between: (k, 5) as in ``Slips``, and signs (k,) for the order of the two edges of a pair.
    """

    vertices: Integers
    coefficients: Floats
    normals: Floats
    limits: Floats
    origin: Floats
    reach: float
    begun: Floats
    between: Integers
    signs: Floats

    def slip(self, positions: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Tangential motion of the closest points (k, 3), and its smoothed length f: f, f'/l and f'', each (k,)."""
        sliding = pair_loops.slips(positions, self.origin, self.vertices, self.coefficients, self.normals)
        sliding += self.begun
        return sliding, *smooth_length(np.linalg.norm(sliding, axis=1), self.reach)


class SurfaceContact:
    """Contact of surfaces; bodies have the row of their first point, or None if they are at rest.

    Vertices: all rows of the positions, then those of bodies at rest.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        bodies: Sequence[tuple[TriangleObstacle, int | None]],
        settings: ContactSettings,
        rows: int,
    ) -> None:
        self.settings, self.rows = settings, rows
        still = [body.points(0.0) for body, first in bodies if first is None]
        self.fixed = np.concatenate([np.zeros((0, 3)), *still])
        rest = np.zeros((rows + len(self.fixed), 3))
        rest[: mesh.vertex_count] = mesh.assembled
        faces, next_row = [mesh.triangles], rows
        for body, first in bodies:
            points = body.points(0.0)
            start = next_row if first is None else first
            next_row += len(points) if first is None else 0
            rest[start : start + len(points)] = points
            faces.append(body.triangles + start)
        triangles = np.concatenate(faces).astype(np.int64)
        self.search = PairSearch(triangles, len(mesh.triangles), rest, settings)
        sizes = [len(body.triangles) for body, _ in bodies]
        self._owners = np.repeat(np.arange(CLOTH, len(sizes)), [len(mesh.triangles), *sizes])
        self._grip: _Grip | None = None

    def start_step(
        self, positions: Floats, duration: float, time: float, number: int = 0, slips: Slips | None = None
    ) -> None:
        if self.settings.friction == 0.0:
            return
        everything = self.everything(positions)
        close = self.search.close(everything)
        slope = barrier(close.distances, self.settings.thickness)[1]
        apart = np.einsum("nk,nki->ni", close.coefficients, everything[close.vertices])
        normals, reach = apart / close.distances[:, None], self.settings.slip * duration
        swapped = ~close.is_corner & (close.vertices[:, 0] > close.vertices[:, 2])
        between = np.column_stack([2 * number + close.is_corner, close.vertices])
        between[swapped, 1:] = close.vertices[swapped][:, [2, 3, 0, 1]]
        signs = np.where(swapped, -1.0, 1.0)
        self._grip = _Grip(
            close.vertices,
            close.coefficients,
            normals,
            -self.settings.friction * close.weights * close.fade[0] * slope,
            everything,
            reach,
            signs[:, None] * begun_with(slips, between, normals, reach),
            between,
            signs,
        )

    def slips(self, positions: Floats) -> Slips:
        """Elastic slips at the end of a step."""
        grip = self._grip
        if grip is None:
            return Slips(np.zeros((0, 5), np.int64), np.zeros((0, 3)))
        sliding = grip.slip(self.everything(positions))[0]
        return ended_with(grip.between, grip.signs[:, None] * sliding, grip.reach)

    def value(self, positions: Floats) -> float:
        everything = self.everything(positions)
        close = self.search.close(everything)
        if not close.distances.all():
            return math.inf
        energy = barrier(close.distances, self.settings.thickness)[0]
        value = float((close.weights * close.fade[0]) @ energy)
        if self._grip is not None:
            value += float(self._grip.limits @ self._grip.slip(everything)[1])
        return value

    def gradient(self, positions: Floats, gradient: Floats) -> float:
        everything = self.everything(positions)
        close = self.search.close(everything)
        if not close.distances.all():
            return math.inf
        energy, slope, _ = barrier(close.distances, self.settings.thickness)
        fade, turning, _ = close.fade
        forces = np.zeros_like(everything)
        pair_loops.add_forces(
            everything,
            close.vertices,
            close.coefficients,
            close.weights * fade * slope / close.distances,
            close.weights * turning * energy,
            forces,
        )
        value = float((close.weights * fade) @ energy)
        if self._grip is not None:
            grip = self._grip
            sliding, potential, rate, _ = grip.slip(everything)
            pair_loops.add_pulls(
                grip.vertices, grip.coefficients, (grip.limits * rate)[:, None] * sliding, forces
            )
            value += float(grip.limits @ potential)
        gradient += forces[: self.rows]
        return value

    def hessian(self, positions: Floats) -> tuple[Integers, Floats]:
        everything, grip = self.everything(positions), self._grip
        close = self.search.close(everything)
        count = len(close.distances)
        pairs = close.vertices if grip is None else np.concatenate([close.vertices, grip.vertices])
        slots, starts, found = pair_hessian.block_slots(pairs, self.rows)
        blocks = np.zeros((len(found), 9))
        energy, slope, bend = barrier(close.distances, self.settings.thickness)
        fade, turning, turned = (close.weights * factor for factor in close.fade)
        pair_hessian.add_repulsion(
            everything,
            close.vertices,
            close.is_corner,
            close.coefficients,
            fade * slope,
            fade * bend,
            turning * energy,
            turned * energy,
            slots[:count],
            blocks,
        )
        if grip is not None:
            sliding, _, rate, change = grip.slip(everything)
            pair_hessian.add_friction(
                grip.vertices,
                grip.coefficients,
                grip.normals,
                sliding,
                grip.limits * rate,
                grip.limits * change,
                slots[count:],
                blocks,
            )
        keys = pair_hessian.scalar_keys(starts, found, 3 * self.rows)
        return keys, pair_hessian.scalar_entries(starts, found, blocks, len(keys))

    def room(self, positions: Floats, within: float) -> Integers:
        """Keys, as of ``hessian``, of pairs closer than ``within`` [m]."""
        near = self.search.nearer(self.everything(positions), within)
        _, starts, found = pair_hessian.block_slots(near, self.rows)
        return pair_hessian.scalar_keys(starts, found, 3 * self.rows)

    def bound(self, positions: Floats, step: Floats) -> float:
        start, end = self.everything(positions), self.everything(positions + step)
        moves = end - start
        known, share = self.search.known(start, moves)
        if known is not None and 0.0 < share < 1.0:
            # Steps that are cut short need no search along their whole length.
            fraction = _free_fraction(known, start, moves, share)
            if fraction < share:
                return fraction
        return _free_fraction(self.search.along(start, end), start, moves, 1.0)

    def closest(self, positions: Floats) -> float:
        return float(self.search.close(self.everything(positions)).distances.min(initial=math.inf))

    def intersects(self, positions: Floats) -> bool:
        triangles, cloth = self.search.surfaces.triangles, self.search.surfaces.cloth
        within = self.settings.self_contact
        everything = self.everything(positions)
        return len(crossing_triangles(everything, triangles, cloth, within_cloth=within)[0]) > 0

    def crossings(self, positions: Floats, numbers: Sequence[int], names: Sequence[str]) -> list[Crossing]:
        """Crossings, found as by ``intersects``; numbers, names: of the bodies among the obstacles."""
        found = surface_crossings(
            self.everything(positions), self.search.surfaces.triangles, self._owners, names,
            within_cloth=self.settings.self_contact,
        )  # fmt: skip
        return [c if c.body == CLOTH else replace(c, body=numbers[c.body]) for c in found]

    def everything(self, positions: Floats) -> Floats:
        """Every vertex."""
        return np.concatenate([positions, self.fixed])


def _free_fraction(pairs: Pairs, start: Floats, moves: Floats, until: float) -> float:
    """Fraction of moves (nv, 3), up to ``until``, during which all pairs keep a part of their distance."""

    moved, ways = np.linalg.norm(start - pairs.origin, axis=1), np.linalg.norm(moves, axis=1)

    def part(bounds: tuple[int, int]) -> float:
        return pair_loops.free_fraction(
            start, moves, pairs.vertices, pairs.corners, pairs.gaps, moved, ways, _KEPT, until, *bounds
        )

    return min(run_parts(part, shares(len(pairs.vertices))))

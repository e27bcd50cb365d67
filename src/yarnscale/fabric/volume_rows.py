"""A homogenized volume whose outermost rows are full yarns, where they are unlike any period.

Loops of a held row hang by one point each, straighten their heads and give way to the row below. Loops of a first row
that are closed with each other, as a cast-on does, are a chain that does not widen with the rows above. The control
points of these rows are unknowns themselves, with the energy of their own yarns; cells represent the area of the other
rows. Those rows which full yarns are tied to or may touch follow from the mid-surface and the fluctuations of the cells
(``VolumePoints``), and pass on the forces to both.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.sparse import block_diag, bsr_array, csr_array, hstack, tril

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError
from yarnscale.fabric.border_rows import BorderRows
from yarnscale.fabric.spline_knit import CurvePoints, SplineFabric
from yarnscale.fabric.spline_model import SplineEnergy, evenly_shifted
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.fabric.volume_cells import Reduction, VolumeCells, cell_unknowns
from yarnscale.numerics.block_pattern import BlockPattern
from yarnscale.numerics.factor import SymmetricPattern, by_rows, places_among
from yarnscale.numerics.regularisation import ShiftedHessian

_BESIDE = 2
"""Rows beside full yarns that these may touch."""


def rows_of_cells(fabric: SplineFabric, held: CurvePoints | None) -> range:
    """The rows that cells represent: neither held, nor closed with themselves, nor next below held ones.

    At least two are left to cells where there are as many that are not held. Raises InputError where other rows than
    the last ones have held points.
    """
    yarns, last = fabric.yarn_count, fabric.yarn_count
    first = int((fabric.first.yarn == fabric.second.yarn).any() and last > _BESIDE)
    if held is not None and len(held):
        rows = np.unique(held.yarn)
        last = int(rows[0])
        if last < 1 or len(rows) < yarns - last:
            found = f"rows {rows.tolist()} of {yarns}"
            wanted = "the last ones, and at least one row that is free"
            raise InputError("held rows of a homogenized volume", expected=wanted, found=found)
        first = min(first, max(last - _BESIDE, 0))
        last -= last - first > _BESIDE
    return range(first, last)


class _Border:
    """Full yarns at one border, and rows beside that follow from cells, as a function of a full vector (size,).

    unknowns: those of the full yarns. full: their energy and mass; rows: with what is between them and rows beside.
    """

    def __init__(
        self, fabric: SplineFabric, own: range, inner: range, cells: VolumeCells, begin: int, end: int
    ) -> None:
        """own: full yarns; inner: rows of ``cells``. begin: first unknown of these full yarns; end: first of cells."""
        above, points = own.start > 0, fabric.points_per_yarn
        near = inner[-_BESIDE:] if above else inner[:_BESIDE]
        rows = fabric.part(min(near.start, own.start), max(near.stop, own.stop))
        self.rows = BorderRows(rows, np.arange(len(own)) + (len(near) if above else 0))
        self._beside = cells.points.of(slice((near.start - inner.start) * points, (near.stop - inner.start) * points))
        self.full = SplineEnergy(fabric.part(own.start, own.stop))
        self.unknowns, self._end = slice(begin, begin + self.full.size), end
        numbers = np.arange(rows.yarn_count * points)
        split = len(near) * points if above else len(own) * points
        self._near, self._own = (numbers[:split], numbers[split:]) if above else (numbers[split:], numbers[:split])
        behind = self._beside.nodes + end // 3
        counts = np.full(len(numbers), behind.shape[1])
        counts[self._own] = 1
        starts = np.concatenate([[0], np.cumsum(counts)])
        self._size, self._starts, columns = end + cells.size, starts, np.empty(starts[-1], np.int64)
        self._filled = starts[self._near][:, None] + np.arange(behind.shape[1])
        columns[self._filled], columns[starts[self._own]] = behind, begin // 3 + np.arange(len(self._own))
        self._columns, self._behind = columns, behind
        self._one = np.zeros((starts[-1], 3, 3))
        self._one[starts[self._own]] = np.eye(3)
        groups = csr_array((np.ones(len(columns)), columns, starts), shape=(len(numbers), self._size // 3))
        meeting = self.rows.meeting @ groups
        lower = tril(meeting.T @ meeting).tocoo()
        self.keys = lower.col.astype(np.int64) * (self._size // 3) + lower.row
        """Pairs of points of unknowns that meet in the Hessian, as keys."""
        self._laid: tuple[SymmetricPattern, tuple[Integers, ...], tuple[Integers, Integers] | None] | None = None

    def _joined(self, own: Array, beside: Array) -> Array:
        points = np.empty((len(self._own) + len(self._near), 3))
        points[self._own], points[self._near] = own.reshape(-1, 3), beside
        return points

    def control(self, x: Array) -> Array:
        """Control points of the full yarns and of the rows beside (n, 3) [m]."""
        return self._joined(x[self.unknowns], self._beside.at(x[self._end :]))

    def bound(self, x: Array, step: Array) -> float:
        """Fraction of a step (size,) [m] in which no yarns meet, but for what surfaces turn in it."""
        moves = self._joined(step[self.unknowns], self._beside.moves(x[self._end :], step[self._end :]))
        return self.rows.touch.bound(self.control(x).ravel(), moves.ravel())

    def _slopes(self, x: Array) -> bsr_array:
        blocks = self._one.copy()
        blocks[self._filled] = self._beside.slopes(x[self._end :])
        shape = 3 * (len(self._starts) - 1), self._size
        return bsr_array((blocks, self._columns, self._starts), shape=shape)

    def gradient(self, x: Array, gradient: Array) -> float:
        """Energy [J]; adds the gradient [N]."""
        value, force = self.rows.gradient(self.control(x))
        gradient += self._slopes(x).T @ force.ravel()
        return value

    def hessian(self, x: Array, gradient: Array, blocks: BlockPattern, entries: Array) -> float:
        """Energy [J]; adds the gradient [N] and the Hessian [N/m], which has its places in ``blocks``."""
        value, force, model = self.rows.quadratic(self.control(x))
        slopes = self._slopes(x)
        back = slopes.T.tobsr((3, 3))
        gradient += back @ force.ravel()
        if self._laid is None or self._laid[0] is not model.pattern:
            self._laid = model.pattern, _whole(model.pattern), None
        _, (order, *where), placed = self._laid
        whole = back @ (csr_array((model.entries[order], *where)).tobsr((3, 3)) @ slopes)
        if placed is None:
            row = np.repeat(np.arange(self._size // 3), np.diff(whole.indptr))
            placed = self._placed(blocks, row, whole.indices)
            self._laid = model.pattern, (order, *where), placed
        kept, places = placed
        blocks.add_blocks(places, whole.data[kept].reshape(-1, 9), entries)
        pulled = np.flatnonzero(force[self._near].any(axis=1))
        bends = self._beside.of(pulled).bend(x[self._end :], force[self._near[pulled]])
        b, c = np.tril_indices(self._behind.shape[1])
        behind = self._behind[pulled].T
        kept, places = self._placed(blocks, behind[b].ravel(), behind[c].ravel())
        blocks.add_blocks(places, bends.reshape(-1, 9)[kept], entries)
        return value

    @staticmethod
    def _placed(blocks: BlockPattern, row: Integers, column: Integers) -> tuple[Integers, Integers]:
        """Which blocks below the diagonal are in a pattern, and where; others are of yarns far apart at rest."""
        known, keys = blocks.keys, column.astype(np.int64) * (len(blocks.starts) - 1) + row
        places = np.minimum(np.searchsorted(known, keys), len(known) - 1)
        kept = np.flatnonzero((row >= column) & (known[places] == keys))
        return kept, places[kept]


def _whole(pattern: SymmetricPattern) -> tuple[Integers, Integers, Integers]:
    """Both triangles of a symmetric matrix by rows: places of the entries in the pattern, columns, begins of rows."""
    rows, columns = pattern.rows, pattern.columns
    below = np.flatnonzero(rows > columns)
    both = np.concatenate([rows, columns[below]]), np.concatenate([columns, rows[below]])
    order, columns, begins = by_rows(*both, pattern.size)
    return np.concatenate([np.arange(pattern.entries), below])[order], columns, begins


class RowsOnCells:
    """Energy [J], its derivatives [N, N/m] and mass of full yarns around ``VolumeCells``; for ``SplineMotion``.

    Full vectors: control points of the rows that are full yarns, the first ones first; then the vector of the cells;
    all [m].
    """

    def __init__(self, yarns: SplineEnergy, volume: BoundingVolume, inner: range) -> None:
        """inner: rows that cells represent."""
        fabric, per_row = yarns.fabric, 3 * yarns.fabric.points_per_yarn
        below, volume = _within(fabric, volume, inner)
        self.cells = VolumeCells(SplineEnergy(below), volume)
        self._first, self._last = per_row * inner.start, per_row * inner.stop
        self._own = self._first + per_row * fabric.yarn_count - self._last
        ends = [(range(inner.start), 0), (range(inner.stop, fabric.yarn_count), self._first)]
        self._borders = [_Border(fabric, own, inner, self.cells, begin, self._own) for own, begin in ends if len(own)]
        self.size = self._own + self.cells.size
        rows = [fabric.control[own.start : own.stop].reshape(-1, 3) for own, _ in ends]
        self.at_rest = np.concatenate([*rows, self.cells.at_rest])
        self._make_pattern()

    def _make_pattern(self) -> None:
        cells, nodes, groups = self.cells.pattern, self._own // 3, self.size // 3
        of_cells = np.unique((cells.columns // 3 + nodes) * groups + cells.rows // 3 + nodes)
        self._blocks = BlockPattern.from_keys(
            np.full(groups, 3), np.concatenate([of_cells, *(border.keys for border in self._borders)])
        )
        self.pattern = self._blocks.pattern
        self._of_cells = self._shifted(cells, self._own)
        self.mass_entries = np.zeros(self.pattern.entries)
        self.mass_entries[self._of_cells] = self.cells.mass_entries
        for border in self._borders:
            places = self._shifted(border.full.pattern, border.unknowns.start)
            self.mass_entries[places] = border.full.mass_entries

    def _shifted(self, part: SymmetricPattern, begin: int) -> Integers:
        """Where the entries of a part are whose first unknown is ``begin``."""
        places = places_among(self.pattern.keys, (part.columns + begin) * self.size + part.rows + begin)
        assert places is not None
        return places

    def mass_matrix(self) -> csr_array:
        """Mass matrix of one component of full yarns and mid-surface [kg]."""
        full = [border.full.mass_matrix() for border in self._borders]
        return csr_array(block_diag([*full, self.cells.mass_matrix()]))

    def weight(self, acceleration: Array) -> Array:
        """Force of a uniform acceleration (3,) [m/s²] on the control points of full yarns and mid-surface [N]."""
        full = [border.full.weight(acceleration) for border in self._borders]
        return np.concatenate([*full, self.cells.weight(acceleration)])

    def rows(self, points: csr_array) -> csr_array:
        """Matrix (3k, size) to points of yarns, within the volume taken as on the mid-surface.

        points: from the control points of all yarns.
        """
        first, inner, last = (
            points[:, a:b] for a, b in ((0, self._first), (self._first, self._last), (self._last, None))
        )
        return csr_array(hstack([first, last, self.cells.rows(csr_array(inner))]))

    def yarns(self, positions: Array, velocities: Array) -> tuple[Array, Array]:
        """Control points of all yarns (n, 3) [m], and their velocities, without those of fluctuations [m/s]."""
        own, first = self._own // 3, self._first // 3
        inner = self.cells.yarns(positions[own:], velocities[own:])
        full = (positions, velocities)
        points, speeds = (
            np.concatenate([of[:first], middle, of[first:own]]) for of, middle in zip(full, inner, strict=True)
        )
        return points, speeds

    def value(self, x: Array) -> float:
        """Energy [J]; inf where the surface has no area."""
        value = self.cells.value(x[self._own :])
        if value == math.inf:
            return value
        value += sum(border.rows.value(border.control(x)) for border in self._borders)
        return value if math.isfinite(value) else math.inf

    def gradient(self, x: Array) -> tuple[float, Array]:
        """Energy [J] and gradient (size,) [N]."""
        value, of_cells = self.cells.gradient(x[self._own :])
        gradient = np.concatenate([np.zeros(self._own), of_cells])
        return value + sum(border.gradient(x, gradient) for border in self._borders), gradient

    def quadratic(self, x: Array) -> tuple[float, Array, ShiftedHessian]:
        """Energy [J], gradient [N] and Hessian [N/m]."""
        value, of_cells, model = self.cells.quadratic(x[self._own :])
        gradient, entries = np.concatenate([np.zeros(self._own), of_cells]), np.zeros(self.pattern.entries)
        entries[self._of_cells] = model.entries
        for border in self._borders:
            value += border.hessian(x, gradient, self._blocks, entries)
        return value, gradient, evenly_shifted(self.pattern, entries)

    def bound(self, x: Array, step: Array) -> float:
        """Fraction of a step (size,) [m] in which no yarns meet, but for what surfaces turn in it."""
        bounds = [border.bound(x, step) for border in self._borders]
        return min(self.cells.bound(x[self._own :], step[self._own :]), *bounds)

    def forget(self) -> None:
        """List contacts anew."""
        self.cells.forget()
        for border in self._borders:
            border.rows.touch.forget()


def _within(fabric: SplineFabric, volume: BoundingVolume, rows: range) -> tuple[SplineFabric, BoundingVolume]:
    """Some rows, and the volume around them alone."""
    part = fabric.part(rows.start, rows.stop)
    y = part.control[..., 1]
    return part, volume.along_y(float(y.min()), float(y.max()))


def cells_of(
    yarns: SplineEnergy, volume: BoundingVolume, held: CurvePoints | None, loaded: bool
) -> VolumeCells | RowsOnCells:
    """A fabric in a homogenized volume, outermost rows as full yarns where it has such. Raises InputError.

    loaded: by handles or obstacles, which act on the mid-surface, so that there are no held points.
    """
    if loaded and held is not None:
        raise InputError("held points in a homogenized volume", expected="none beside loads, which have handles")
    inner = rows_of_cells(yarns.fabric, held)
    return VolumeCells(yarns, volume) if len(inner) == yarns.fabric.yarn_count else RowsOnCells(yarns, volume, inner)


def spline_counts(
    fabric: SplineFabric, volume: BoundingVolume | None, reduction: Reduction, held: CurvePoints | None
) -> dict[str, int]:
    """Sizes as LOD03 Figure 9 counts them; ``reduced_unknowns`` with a volume.

    Homogenized: also ``cell_unknowns``, which a factorisation eliminates cell by cell, and ``row_unknowns``: those of
    rows that are full yarns, which are among the ``reduced_unknowns``.
    """
    counts = fabric.counts()
    if volume is None:
        return counts
    if reduction == "published":
        return counts | {"reduced_unknowns": 3 * volume.count}
    inner = rows_of_cells(fabric, held)
    own = 3 * (fabric.yarn_count - len(inner)) * fabric.points_per_yarn
    cells = cell_unknowns(*_within(fabric, volume, inner))
    return counts | {"reduced_unknowns": 3 * volume.count // 2 + own, "row_unknowns": own, "cell_unknowns": cells}

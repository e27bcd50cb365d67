"""Yarns continued across seams: ends on either side are joined one to one.

With both panels laid flat beside each other, each yarn end has a continuation (the next vertex of the pattern, beyond
the border). An end is joined to the end of the other panel that is nearest to this place if the converse holds too; the
closest pairs come first. Both are of one material. Where the pattern is continuous, the partner is the next vertex.
Elsewhere a smooth bridge replaces the last vertices of both.
Ends without a partner within half a stitch, because one panel has more of them, are joined to a neighbour on their own
side, as at a loop that is cut off; the rest stays cut.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.detail.alignment import aligned_tilings
from yarnscale.detail.tiling import Bridges, Tilings, YarnLayout
from yarnscale.shell.mesh import TriangleMesh
from yarnscale.yarn.pattern import YarnPattern

_EXACT = 0.5
"""Distance of two ends, in steps of the yarn, below which they are joined without a bridge."""


def sewn_layout(pattern: YarnPattern, mesh: TriangleMesh, tilings: Tilings | None = None) -> YarnLayout:
    """The pattern laid over all panels, continuous across seams where possible, with the yarns joined there.

    tilings: offsets of the pattern, default ``aligned_tilings``. Without seams, and in its errors, like
    ``YarnLayout.of``.
    """
    if tilings is None:
        tilings = aligned_tilings(pattern.period, mesh)
    layout = YarnLayout.pieces(pattern, mesh, tilings)
    if mesh.has_seams and len(layout.yarn):
        layout = _joined(layout, pattern, mesh)
    return layout.without_snippets(pattern, mesh)


@dataclass(frozen=True, eq=False)
class YarnEnds:
    """Ends of open yarns at a seam.

    end: 2·curve for its first vertex, 2·curve + 1 for its last one, (k,). place: reference coordinates and height,
    (k, 3) [m]; step: from there to the continuation of the yarn, (k, 3) [m]; panel: (k,); kind: (k,)
    number of the yarn's material. seen: place, step and panel in the coordinates of
    the other side of the seam, continued flat beyond its border.
    """

    end: Integers
    place: Array
    step: Array
    panel: Integers
    kind: Integers
    seen_place: Array
    seen_step: Array
    seen_panel: Integers

    @classmethod
    def of(cls, layout: YarnLayout, pattern: YarnPattern, mesh: TriangleMesh) -> YarnEnds:
        """Those whose next vertex is beyond a sewn edge."""
        curves = np.flatnonzero(~layout.closed)
        end = np.column_stack([2 * curves, 2 * curves + 1]).ravel()
        vertex = np.where(end % 2 == 0, layout.offsets[end // 2], layout.offsets[end // 2 + 1] - 1)
        place = np.column_stack([layout.material[vertex], pattern.vertices[layout.vertex[vertex], 2]])
        step = _steps(pattern, layout.vertex[vertex], forward=end % 2 == 1)
        step[:, :2] *= layout.stretch[vertex]
        panel = layout.panel[vertex]
        edge = _nearest_seam(mesh, place[:, :2] + 0.5 * step[:, :2], panel, 0.5 * pattern.radius)
        sewn = edge >= 0
        end, place, step, panel = end[sewn], place[sewn], step[sewn], panel[sewn]
        numbers = mesh.sewn_edges[edge[sewn]]
        points = mesh.material[numbers]
        seen_place, seen_step = place.copy(), step.copy()
        seen_place[:, :2], seen_step[:, :2] = _across(points, place[:, :2], step[:, :2])
        kind = pattern.material_of_vertex[layout.vertex[layout.offsets[end // 2]]]
        return cls(end, place, step, panel, kind, seen_place, seen_step, mesh.panel_numbers[numbers[:, 2]])


def _steps(pattern: YarnPattern, vertex: Integers, *, forward: Flags) -> Array:
    """From vertices (k,) to the next one along the yarn, or to the one before, (k, 3) [m]."""
    edges = pattern.edges
    along = pattern.vertices[edges[:, 1]] - pattern.vertices[edges[:, 0]]
    along[:, :2] += edges[:, 2:] * pattern.period
    # Edge i starts at vertex i.
    return np.where(forward[:, None], along[vertex], -along[pattern.previous_vertex[vertex]])


def _across(points: Array, places: Array, steps: Array) -> tuple[Array, Array]:
    """Places and steps (k, 2) beside one side of sewn edges as the other side has them; points as ``sewn_edges``."""
    start, other = points[:, 0], points[:, 2]
    along, onward = points[:, 1] - start, points[:, 3] - other
    size = np.linalg.norm(along, axis=1)
    unit, turned = along / size[:, None], onward / np.linalg.norm(onward, axis=1)[:, None]

    def seen(vectors: Array, scale: Array) -> Array:
        ahead = np.einsum("kc,kc->k", vectors, unit) * scale
        aside = unit[:, 0] * vectors[:, 1] - unit[:, 1] * vectors[:, 0]
        return ahead[:, None] * turned + aside[:, None] * np.column_stack([-turned[:, 1], turned[:, 0]])

    scale = np.linalg.norm(onward, axis=1) / size
    return other + seen(places - start, scale), seen(steps, np.ones_like(scale))


def _nearest_seam(mesh: TriangleMesh, places: Array, panel: Integers, spacing: float) -> Integers:
    """Row of ``sewn_edges`` that is the nearest border to places (k, 2) on panels (k,); −1: a free edge is."""
    sewn = mesh.sewn_edges[:, :2]
    free = np.stack([mesh.corners, np.roll(mesh.corners, -1, axis=1)], axis=-1)[~mesh.has_neighbour]
    ends = mesh.material[np.concatenate([sewn, free])]
    numbers = np.concatenate([np.arange(len(sewn)), np.full(len(free), -1)])
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    count = np.ceil(lengths / spacing).astype(np.int64) + 1
    row = np.repeat(np.arange(len(ends)), count)
    share = (np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)) / (count - 1)[row]
    samples = ends[row, 0] + share[:, None] * (ends[row, 1] - ends[row, 0])
    panels = mesh.panel_numbers[np.concatenate([sewn, free])[row, 0]]
    tree = KDTree(np.column_stack([samples, _far_apart(panels, mesh)]))
    return numbers[row[tree.query(np.column_stack([places, _far_apart(panel, mesh)]))[1]]]


def _far_apart(panel: Integers, mesh: TriangleMesh) -> Array:
    """A coordinate that keeps panels apart which lie on each other in the fabric."""
    return 10.0 * float(np.ptp(mesh.material, axis=0).max()) * panel.astype(np.float64)


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Ends that are joined: rows (p, 2), by how much they miss each other and how far they are apart (p,) [m]."""

    rows: Integers
    miss: Array
    gap: Array


def _partners(ends: YarnEnds, mesh: TriangleMesh, reach: float) -> _Pairs:
    """The best pairs across seams; of ends that are left over then, the best on the same side."""
    across = _nearest_pairs(ends, mesh, reach, np.ones(len(ends.end), bool))
    left = np.ones(len(ends.end), bool)
    left[across.rows] = False
    own_side = replace(ends, seen_place=ends.place, seen_step=ends.step, seen_panel=ends.panel)
    beside = _nearest_pairs(own_side, mesh, reach, left)
    return _Pairs(*(np.concatenate([getattr(p, name) for p in (across, beside)]) for name in ("rows", "miss", "gap")))


def _nearest_pairs(ends: YarnEnds, mesh: TriangleMesh, reach: float, free: Flags) -> _Pairs:
    """Pairs of free ends that miss each other by less than ``reach`` [m], the best first, each end once."""
    tree = KDTree(np.column_stack([ends.place, _far_apart(ends.panel, mesh)]))
    aim = ends.seen_place + 0.5 * ends.seen_step
    found = tree.query_ball_point(
        np.column_stack([aim, _far_apart(ends.seen_panel, mesh)]),
        reach + 0.5 * float(np.linalg.norm(ends.step, axis=1).max(initial=0.0)),
    )
    one = np.repeat(np.arange(len(found)), [len(near) for near in found])
    two = np.fromiter((k for near in found for k in near), np.int64, len(one))
    # At the same seam, and never one end with itself.
    fits = (ends.seen_panel[two] == ends.panel[one]) & (one != two) & free[one] & free[two]
    fits &= ends.kind[one] == ends.kind[two]
    one, two = one[fits], two[fits]
    gap = ends.place[two] - ends.seen_place[one]
    miss = 0.5 * (np.linalg.norm(gap - ends.seen_step[one], axis=1) + np.linalg.norm(gap + ends.step[two], axis=1))
    chosen, left = [], free.copy()
    for k in np.argsort(miss, kind="stable").tolist():
        if miss[k] <= reach and left[one[k]] and left[two[k]]:
            left[one[k]] = left[two[k]] = False
            chosen.append(k)
    rows = np.column_stack([one[chosen], two[chosen]])
    return _Pairs(rows, miss[chosen], np.linalg.norm(gap[chosen], axis=1))


def _joined(layout: YarnLayout, pattern: YarnPattern, mesh: TriangleMesh) -> YarnLayout:
    """The layout with its pieces joined at seams, by bridges where they do not meet."""
    ends = YarnEnds.of(layout, pattern, mesh)
    pairs = _partners(ends, mesh, 0.5 * float(pattern.period.max()))
    joints = _Joints.of(ends.end[pairs.rows], pairs, 2 * len(layout.yarn), float(pattern.rest_length.mean()))
    order, bridge, lengths, first, closed = [], [], [], [], []
    for chain, ring in _chains(joints.partner, layout.closed):
        rows, shares = _rows(layout, joints, chain, ring=ring)
        order.append(rows)
        bridge.append(shares)
        lengths.append(len(rows))
        first.append(max(chain, key=lambda e: layout.offsets[e // 2 + 1] - layout.offsets[e // 2]) // 2)
        closed.append(ring)
    rows, shares = np.concatenate(order), np.concatenate(bridge)
    offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
    closed = np.array(closed, bool)
    return layout.among(
        rows,
        offsets=offsets,
        yarn=layout.yarn[np.array(first)],
        closed=closed,
        bridges=_bridges(shares, offsets, closed),
    )


@dataclass(frozen=True, eq=False)
class _Joints:
    """What becomes of every end (2·curves,): partner or −1; vertices it gives up to its bridge and those put in."""

    partner: Integers
    given: Integers
    put_in: Integers

    @classmethod
    def of(cls, joined: Integers, pairs: _Pairs, count: int, step: float) -> _Joints:
        """Of joined ends (p, 2) among ``count``; step: usual length between vertices [m]."""
        partner = np.full(count, -1, np.int64)
        given, put_in = np.zeros(count, np.int64), np.zeros(count, np.int64)
        partner[joined] = joined[:, ::-1]
        # Where the ends do not meet, both give up about as much length as they miss each other by.
        wide = pairs.miss > _EXACT * step
        given[joined] = np.where(wide, np.ceil(pairs.miss / step), 0)[:, None]
        put_in[joined] = np.where(wide, np.maximum(1, np.rint(pairs.gap / step)), 0)[:, None]
        return cls(partner, given, put_in)


def _chains(partner: Integers, closed: Flags) -> list[tuple[list[int], bool]]:
    """Pieces in the order of each joined yarn, as the end that each is entered by, and whether it is a ring."""
    chains, used = [], closed.copy()
    starts = np.flatnonzero(partner < 0)
    for start in [*starts.tolist(), *range(0, len(partner), 2)]:
        if used[start // 2]:
            continue
        chain, end = [], start
        while end >= 0 and not used[end // 2]:
            used[end // 2] = True
            chain.append(end)
            end = int(partner[end ^ 1])
        chains.append((chain, end == start))
    return chains + [([2 * int(c)], True) for c in np.flatnonzero(closed)]


def _rows(layout: YarnLayout, joints: _Joints, chain: list[int], *, ring: bool) -> tuple[Integers, Array]:
    """Vertices of the layout in the order of a joined yarn, and the share of each along its bridge, else 0.

    Vertices of bridges repeat the one before them.
    """
    pieces = [_trimmed(layout, joints, end) for end in chain]
    rows, shares = [], []
    for number, (end, (piece, _, back)) in enumerate(zip(chain, pieces, strict=True)):
        rows.append(piece)
        shares.append(np.zeros(len(piece)))
        count = int(joints.put_in[end ^ 1])
        if count and (ring or number + 1 < len(chain)):
            count += back + pieces[(number + 1) % len(chain)][1]
            rows.append(np.full(count, piece[-1]))
            shares.append(np.arange(1, count + 1) / (count + 1))
    return np.concatenate(rows), np.concatenate(shares)


def _trimmed(layout: YarnLayout, joints: _Joints, end: int) -> tuple[Integers, int, int]:
    """Vertices of a piece entered by an end, without those it gives up, and how many these are in front and behind."""
    begin, stop = int(layout.offsets[end // 2]), int(layout.offsets[end // 2 + 1])
    rows = np.arange(begin, stop) if end % 2 == 0 else np.arange(stop - 1, begin - 1, -1)
    # Two vertices stay, if there are two, to say where the piece goes.
    front, back, spare = int(joints.given[end]), int(joints.given[end ^ 1]), max(0, len(rows) - 2)
    if front + back > spare:
        front, back = spare * front // (front + back), spare * back // (front + back)
    return rows[front : len(rows) - back], front, back


def _bridges(shares: Array, offsets: Integers, closed: Flags) -> Bridges:
    """Bridges among vertices with these shares (n,), 0 for those that the pattern has; curves begin with such."""
    own, bridge = np.flatnonzero(shares == 0), np.flatnonzero(shares > 0)
    curve = np.repeat(np.arange(len(closed)), np.diff(offsets))
    first = np.searchsorted(own, offsets[:-1])
    last = np.searchsorted(own, offsets[1:]) - 1
    which = curve[bridge]
    end = np.searchsorted(own, bridge)

    def wrapped(place: Integers) -> Integers:
        """Back into the curve: round a ring, held at the ends of an open yarn."""
        size = last[which] - first[which] + 1
        round_ = first[which] + (place - first[which]) % size
        return np.where(closed[which], round_, np.clip(place, first[which], last[which]))

    anchors = np.column_stack([own[wrapped(end + k)] for k in (-2, -1, 0, 1)])
    return Bridges(bridge, anchors.reshape(-1, 4), shares[bridge])

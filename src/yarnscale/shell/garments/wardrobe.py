"""Built-in garments: sweater, T-shirt and scarf, in any resolution.

Sweater and T-shirt have drop shoulders: front and back are rectangles with a neck, the sleeves trapezoids
sewn to the straight sides. They start flat, front over back with a round edge between
them, without contact and almost without stretch; a thin body fits between the layers.
Coordinates are those of the ``mannequin``: x across, y to the back, z up.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from yarnscale.arrays import Array, Flags
from yarnscale.errors import InputError, positive
from yarnscale.shell.garments.garment import Garment, Seam, sew
from yarnscale.shell.garments.panels import Panel, check_spacing, cut_panel

_EDGE = 0.03
"""Radius of the round edge between the layers [m]."""


@dataclass(frozen=True)
class ShirtCut:
    """Sizes of a garment with drop shoulders, as it lies flat [m].

    width: of the body; length: from shoulder to hem; neck: half width of the neck; front_neck, back_neck: how deep it
    is cut; armhole: depth of the sleeve where it is sewn on; sleeve: its length; cuff: its depth at the wrist;
    shoulder: height of the shoulder line above the arms.
    """

    width: float = 0.52
    length: float = 0.64
    neck: float = 0.10
    front_neck: float = 0.09
    back_neck: float = 0.025
    armhole: float = 0.22
    sleeve: float = 0.42
    cuff: float = 0.13
    shoulder: float = 0.08

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            positive(f"{name} of the cut", value, "a positive length [m]")
        if self.armhole >= self.length or self.front_neck >= self.length or 2 * self.neck >= self.width:
            raise InputError("cut", expected="neck and armholes smaller than the body", found=vars(self))


SWEATER = ShirtCut()
T_SHIRT = ShirtCut(width=0.50, sleeve=0.16, cuff=0.18, armhole=0.21, neck=0.105, front_neck=0.10)


SEAMS = ("side", "shoulder", "armhole", "under")
"""Kinds of seams of a shirt; "under" closes a sleeve."""


def shirt(name: str, cut: ShirtCut, spacing: float, *, rest_angles: Mapping[str, float] | None = None) -> Garment:
    """Front, back and two sleeves of a cut, sewn and lying flat.

    rest_angles: folds of the seams at rest [rad] by their kind, one of ``SEAMS``; default: flat. Raises InputError.
    """
    angles = dict(rest_angles or {})
    for kind in angles:
        if kind not in SEAMS:
            raise InputError("seam of a shirt", expected=" or ".join(SEAMS), found=kind)
    check_spacing("front", spacing, max(cut.width, cut.length, cut.sleeve))
    rows = max(3, round(cut.armhole / spacing))
    side = max(3, round((cut.length - cut.armhole) / spacing))
    top = max(2, round((0.5 * cut.width - cut.neck) / spacing))
    under = max(3, round(math.hypot(cut.sleeve, cut.armhole - cut.cuff) / spacing))
    cuff = max(4, 2 * round(cut.cuff / spacing))
    body = {"right armhole": rows, "left armhole": rows, "right side": side, "left side": side,
            "right shoulder": top, "left shoulder": top}  # fmt: skip
    panels = [
        cut_panel("front", _body_outline(cut, cut.front_neck), spacing, segments=body),
        cut_panel("back", _body_outline(cut, cut.back_neck), spacing, segments=body),
    ]
    arm = {"first cap": rows, "second cap": rows, "first under": under, "second under": under, "cuff": cuff}
    panels += [cut_panel(f"{s} sleeve", _sleeve_outline(cut), spacing, segments=arm) for s in ("right", "left")]
    positions = {panel.name: _flat_places(cut, panel) for panel in panels}
    return sew(name, panels, _shirt_seams(angles), positions)


def _body_outline(cut: ShirtCut, neck_depth: float) -> dict[str, ArrayLike]:
    """Outline seen from the right side; x is zero in the middle, y at the hem."""
    half, top, arm = 0.5 * cut.width, cut.length, cut.length - cut.armhole
    angle = np.linspace(0.0, math.pi, 60)
    neck = np.column_stack([cut.neck * np.cos(angle), top - neck_depth * np.sin(angle)])
    neck[[0, -1], 1] = top
    return {
        "hem": [[-half, 0.0], [half, 0.0]],
        "right side": [[half, 0.0], [half, arm]],
        "right armhole": [[half, arm], [half, top]],
        "right shoulder": [[half, top], neck[0]],
        "neck": neck,
        "left shoulder": [neck[-1], [-half, top]],
        "left armhole": [[-half, top], [-half, arm]],
        "left side": [[-half, arm], [-half, 0.0]],
    }


def _sleeve_outline(cut: ShirtCut) -> dict[str, ArrayLike]:
    """Outline seen from the right side; x is zero on the fold above the arm, y at the cuff."""
    cuff, cap, top = cut.cuff, cut.armhole, cut.sleeve
    return {
        "cuff": [[-cuff, 0.0], [cuff, 0.0]],
        "first under": [[cuff, 0.0], [cap, top]],
        "first cap": [[cap, top], [0.0, top]],
        "second cap": [[0.0, top], [-cap, top]],
        "second under": [[-cap, top], [-cuff, 0.0]],
    }


def _shirt_seams(angles: Mapping[str, float]) -> list[Seam]:
    # Seen from the front the front's right edge is at +x; the back is seen from behind, its left edge is there.
    pairs = {
        "side": [
            (("front", "right side"), ("back", "left side")),
            (("front", "left side"), ("back", "right side")),
        ],
        "shoulder": [
            (("front", "right shoulder"), ("back", "left shoulder")),
            (("front", "left shoulder"), ("back", "right shoulder")),
        ],
        "armhole": [
            (("front", "right armhole"), ("right sleeve", "second cap")),
            (("back", "left armhole"), ("right sleeve", "first cap")),
            (("front", "left armhole"), ("left sleeve", "first cap")),
            (("back", "right armhole"), ("left sleeve", "second cap")),
        ],
        "under": [
            (("right sleeve", "first under"), ("right sleeve", "second under")),
            (("left sleeve", "first under"), ("left sleeve", "second under")),
        ],
    }
    return [Seam(*pair, angles.get(kind, 0.0)) for kind in SEAMS for pair in pairs[kind]]


def _flat_places(cut: ShirtCut, panel: Panel) -> Array:
    """Where the points of a panel of a shirt lie, (n, 3)."""
    u, v = panel.points.T
    half, top = 0.5 * cut.width, cut.shoulder
    if panel.name in ("front", "back"):
        to_front = np.full(len(u), panel.name == "front")
        flat = np.column_stack([u if panel.name == "front" else -u, v - cut.length + top])
    else:
        out = 1.0 if panel.name == "right sleeve" else -1.0
        to_front = out * u < 0
        flat = np.column_stack([out * (half + cut.sleeve - v), top - np.abs(u)])
    return _with_round_edges(flat, to_front, _closed_edges(cut))


def _closed_edges(cut: ShirtCut) -> list[tuple[Array, Array]]:
    """Segments where front and back meet, as it lies flat, with the inside on their left."""
    half, top = 0.5 * cut.width, cut.shoulder
    arm, hem, wrist = top - cut.armhole, top - cut.length, half + cut.sleeve
    side, under = [half, hem], [half, arm]
    right = [(side, under), (under, [wrist, top - cut.cuff]), ([wrist, top], [cut.neck, top])]
    segments = [(np.array(a, float), np.array(b, float)) for a, b in right]
    mirror = np.array([-1.0, 1.0])
    return segments + [(mirror * b, mirror * a) for a, b in segments]


def _with_round_edges(flat: Array, to_front: Flags, closed: list[tuple[Array, Array]]) -> Array:
    """Two layers that meet in half circles at closed edges: lengths across the edges are kept, (n, 3)."""
    away, inward = np.full(len(flat), np.inf), np.zeros((len(flat), 2))
    for a, b in closed:
        axis = b - a
        along = np.clip((flat - a) @ axis / (axis @ axis), 0.0, 1.0)
        offset = flat - a - along[:, None] * axis
        distance = np.linalg.norm(offset, axis=1)
        normal = np.array([-axis[1], axis[0]]) / np.linalg.norm(axis)
        on_edge = distance < 1e-9
        direction = np.where(on_edge[:, None], normal, offset / np.maximum(distance, 1e-9)[:, None])
        nearer, equal = distance < away - 1e-9, on_edge & (away < 1e-9)
        inward = np.where(nearer[:, None], direction, inward) + equal[:, None] * normal
        away = np.where(nearer, distance, away)
    inward /= np.linalg.norm(inward, axis=1)[:, None]
    angle = np.minimum(away / _EDGE, 0.5 * math.pi)
    # A quarter circle needs less room than the cloth on it is long: the edge itself moves inwards.
    moved = np.where(angle < 0.5 * math.pi, _EDGE * (0.5 * math.pi - np.cos(angle)) - away, 0.0)
    across = flat + moved[:, None] * inward
    depth = np.where(to_front, -1.0, 1.0) * _EDGE * np.sin(angle)
    return np.column_stack([across[:, 0], depth, across[:, 1]])

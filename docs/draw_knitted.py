"""Draw docs/pictures/knitted.png: a piece of 2×2 rib of one yarn, and one of tuck stitches in stripes of two yarns.

Run ``python docs/draw_knitted.py``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from yarnscale.drawing import library
from yarnscale.drawing.knit import knit
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_static import relaxed_sheet
from yarnscale.fabric.knitted_sheet import knitted_sheet, woven_in
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.show.curves import Curve
from yarnscale.show.tubes import yarn_picture
from yarnscale.yarn.material import YarnMaterial

PICTURES = Path(__file__).resolve().parent / "pictures"
TUCKS = ("kk", "kt", "kk", "tk")
GAP = 0.02
"""Between the pieces [m]."""


def main() -> None:
    """Knit, let the yarns come to ease, draw."""
    material = YarnMaterial.preset(library.structure("rib-2x2").material)
    striped = knit(TUCKS, yarns="aabb", wale_spacing=8.5, course_spacing=5.0)
    pieces, curves, right = [], [], 0.0
    for sheet in (knitted_sheet(library.build("rib-2x2"), 2, 10), knitted_sheet(striped, 4, 3, chart=TUCKS)):
        energy = FabricEnergy(sheet, material, springs=woven_in(sheet, material))
        pieces.append(relaxed_sheet(energy, max_iterations=40))
    for piece in pieces:
        curves += _beside(piece, right)
        right = max(float(curve.points[:, 0].max()) for curve in curves) + GAP
    yarn_picture(PICTURES / "knitted.png", curves, pieces[0].radius, camera="top", size=(1200, 640))


def _beside(piece: YarnSheet, left: float) -> list[Curve]:
    """The yarns of a piece that begins at x = ``left`` and lies about y = 0."""
    middle = 0.5 * (piece.vertices[:, 1].min() + piece.vertices[:, 1].max())
    points = piece.vertices - np.array([piece.vertices[:, 0].min() - left, middle, 0.0])
    return [
        Curve(points[a:b], int(kind))
        for a, b, kind in zip(piece.offsets, piece.offsets[1:], piece.yarn_material, strict=False)
    ]


if __name__ == "__main__":
    main()

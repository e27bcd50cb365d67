"""Draw docs/pictures/knitted.png: a piece of 2×2 rib of one yarn, cast on, knitted to and fro and bound off.

Run ``python docs/draw_knitted.py``.
"""

from __future__ import annotations

from pathlib import Path

from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_static import settled
from yarnscale.fabric.knitted_sheet import knitted_sheet, woven_in
from yarnscale.show.curves import Curve
from yarnscale.show.tubes import yarn_picture
from yarnscale.yarn import library
from yarnscale.yarn.material import YarnMaterial

PICTURES = Path(__file__).resolve().parent / "pictures"


def main() -> None:
    """Knit, let the yarn come to ease, draw."""
    material = YarnMaterial.preset(library.structure("rib-2x2").material)
    sheet = knitted_sheet(library.build("rib-2x2"), 2, 5)
    energy = FabricEnergy(sheet, material, springs=woven_in(sheet, material))
    piece = settled(energy, max_iterations=40)
    yarn_picture(
        PICTURES / "knitted.png", [Curve(piece.vertices, 0)], piece.radius, camera="top", size=(1000, 700)
    )


if __name__ == "__main__":
    main()

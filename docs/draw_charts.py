"""Draw every chart of docs/charts into docs/pictures; run it anew when a chart or the drawing changes.

python docs/draw_charts.py
"""

from __future__ import annotations

from pathlib import Path

from PIL import Image

from yarnscale.cell import PeriodicCell
from yarnscale.files.patterns import read_pattern
from yarnscale.show.curves import pattern_curves
from yarnscale.show.tubes import yarn_picture
from yarnscale.yarn.material import YarnMaterial

FOLDER = Path(__file__).parent
SIZE = (320, 280)


def main() -> None:
    """One small picture a chart: the pattern relaxed, with its copies faded; colours are kinds of yarn."""
    material = YarnMaterial.preset("hylc2020-stockinette")
    for path in sorted((FOLDER / "charts").glob("*.chart")):
        cell = PeriodicCell(read_pattern(path), material)
        curves = pattern_curves(cell.pattern, cell.placement(cell.relax()), rings=1)
        picture = FOLDER / "pictures" / f"chart-{path.stem}.png"
        yarn_picture(picture, curves, cell.pattern.radius, camera="top", size=SIZE)
        Image.open(picture).convert("RGB").quantize(64).save(picture, optimize=True)
        print(picture.name)


if __name__ == "__main__":
    main()

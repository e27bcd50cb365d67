"""Pictures of what benchmarks/validation.py has kept: yarns and cloth side by side, and the forces of the stretch test.

python benchmarks/validation_pictures.py DIR --scene stretch|drape PATTERN ... --out PICTURE.png [--forces FORCES.png]

One row a pattern; along the courses to the left, along the wales to the right: yarns, cloth, and both outlines from
above (of the smoothed middle surfaces).
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import pyvista
from matplotlib.axes import Axes
from numpy.typing import NDArray
from PIL import Image
from validation_shapes import silhouettes

from yarnscale.show import theme
from yarnscale.show.canvas import aim, light, screen
from yarnscale.show.curves import Curve
from yarnscale.show.plots import written_figure
from yarnscale.show.seen_tubes import tube_mesh

Array = NDArray[np.float64]
DIRECTIONS = ("course", "wale")
PIXELS = 560
EYES = {"stretch": (0.35, -0.75, 1.0), "drape": (0.5, -1.0, 0.45)}
"""From the sheet to the eye."""
HEADINGS = {
    "stretch": ("pulled along the courses", "pulled along the wales"),
    "drape": ("ball aside along the courses", "ball aside along the wales"),
}
WIDTH, COLOURS = 8.6, 160
"""Of a picture [inches], and how many it is written with."""


def kept(
    folder: Path, name: str, scene: str, direction: str
) -> tuple[dict, dict[str, Array], dict[str, Array]]:
    stem = f"{folder}/{name}-{scene}-{direction}"
    row = json.loads(Path(f"{stem}.json").read_text())
    return row, dict(np.load(f"{stem}-yarns.npz")), dict(np.load(f"{stem}-cloth.npz"))


def rendered(row: dict, yarns: dict[str, Array], cloth: dict[str, Array]) -> list[NDArray[np.uint8]]:
    """Both fabrics as pictures on one scale."""
    whole = np.concatenate([yarns["places"], cloth["places"]])
    found = []
    for woven in (True, False):
        with screen((PIXELS, PIXELS)) as plotter:
            light(plotter)
            if woven:
                lines = np.split(yarns["places"], yarns["pieces"][1:-1].astype(int))
                curves = [Curve(line, k) for k, line in enumerate(lines)]
                plotter.add_mesh(
                    tube_mesh(curves, row["radius"]), scalars="colour", rgb=True, smooth_shading=True
                )
            else:
                surface = pyvista.PolyData.from_regular_faces(cloth["places"], cloth["pieces"].astype(int))
                back = {"color": theme.CLOTH_BACK}
                plotter.add_mesh(surface, color=theme.CLOTH_FRONT, backface_params=back, smooth_shading=True)
            if row["ball"]:
                plotter.add_mesh(pyvista.Sphere(*reversed(row["ball"])), color=theme.OBSTACLE)
            aim(plotter, whole, camera=EYES[row["scene"]])
            found.append(plotter.screenshot(return_img=True))
    return found


def outlines(axes: Axes, yarns: Array, cloth: Array) -> None:
    """Silhouettes from above."""
    for pixels, colour in zip(silhouettes(yarns, cloth, "top"), (theme.SAMPLE, theme.FIT), strict=True):
        axes.contour(pixels.T.astype(float), levels=[0.5], colors=[colour], linewidths=1.2)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_box_aspect(1)


def side_by_side(folder: Path, names: list[str], scene: str, path: Path) -> None:
    """The picture of a scene."""
    with written_figure(path, WIDTH, 1.42 * len(names) + 0.3) as figure:
        panels = figure.subplots(len(names), 6, squeeze=False)
        for line, name in zip(panels, names, strict=True):
            for k, direction in enumerate(DIRECTIONS):
                row, yarns, cloth = kept(folder, name, scene, direction)
                for axes, image in zip(line[3 * k :], rendered(row, yarns, cloth), strict=False):
                    axes.imshow(image, interpolation="antialiased")
                outlines(line[3 * k + 2], yarns["surfaces"][-1], cloth["surfaces"][-1])
            line[0].set_ylabel(name)
        for axes in panels.ravel():
            axes.set(xticks=[], yticks=[])
            axes.grid(False)
            for spine in axes.spines.values():
                spine.set_visible(False)
        for k, heading in enumerate(HEADINGS[scene]):
            for axes, column in zip(
                panels[0, 3 * k :], ("yarns", f"{heading}\ncloth", "outlines"), strict=False
            ):
                axes.set_title(column, fontsize=8)
            for x, (word, colour) in enumerate((("yarns", theme.SAMPLE), ("cloth", theme.FIT))):
                panels[-1, 3 * k + 2].text(
                    0.2 + 0.6 * x, -0.08, word, color=colour, fontsize=7, ha="center", va="top",
                    transform=panels[-1, 3 * k + 2].transAxes,
                )  # fmt: skip
    # A few colours are enough, and a third of the bytes.
    Image.open(path).convert("RGB").quantize(COLOURS).save(path, optimize=True)


def forces(folder: Path, names: list[str], path: Path) -> None:
    """Force of the bars over their way, while they move and when they stand still."""
    with written_figure(path, WIDTH, 2.0) as figure:
        for axes, name in zip(figure.subplots(1, len(names), squeeze=False)[0], names, strict=True):
            for direction, dashes in zip(DIRECTIONS, ("-", "--"), strict=True):
                row, yarns, cloth = kept(folder, name, "stretch", direction)
                for run, colour, label in ((yarns, theme.SAMPLE, "yarns"), (cloth, theme.FIT, "cloth")):
                    way = 1e3 * row["way"] * np.minimum(1.0, run["times"] / row["moving"])
                    axes.plot(way, run["pulls"], dashes, color=colour, label=f"{label}, {direction}")
            axes.set(title=name, xlabel="bars apart by [mm]")
        figure.axes[0].set_ylabel("force [N]")
        lines, labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(lines, labels, fontsize=7, loc="outside upper center", ncols=4)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("patterns", nargs="+")
    parser.add_argument("--scene", choices=tuple(EYES), default="stretch")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--forces", type=Path)
    chosen = parser.parse_args()
    side_by_side(chosen.folder, chosen.patterns, chosen.scene, chosen.out)
    if chosen.forces is not None:
        forces(chosen.folder, chosen.patterns, chosen.forces)

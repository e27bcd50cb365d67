"""Pictures of what benchmarks/validation.py has kept: yarns and cloth side by side, and the forces of the stretch test.

python benchmarks/validation_pictures.py DIR --scene stretch|drape --size 0.1 --friction 0.1 PATTERN ...
    --out PICTURE.png [--forces FORCES.png]

One row a pattern; along the courses to the left, along the wales to the right: yarns, cloth, and both outlines from
above (of the smoothed middle surfaces). Forces of all kept frictions are drawn. Cases that are not kept stay empty.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pyvista
from matplotlib.axes import Axes
from numpy.typing import NDArray
from PIL import Image
from validation_shapes import silhouettes
from validation_table import Kept, kept_runs, pairs

from yarnscale.files.cloth_frames import read_cloth_frames
from yarnscale.files.curve_frames import read_curve_frames
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


def chosen_pairs(options: argparse.Namespace) -> dict[tuple[str, str], list[tuple[Kept, Kept]]]:
    """Pairs of the size that both have finished, by pattern and direction; that of the friction asked for first."""
    found: dict[tuple[str, str], list[tuple[Kept, Kept]]] = {}
    for yarns, cloth in pairs(kept_runs(options.folder)):
        case = yarns.case
        if cloth is None or (case["scene"], case["size"]) != (options.scene, options.size):
            continue
        if options.cloth_friction == (cloth.case["friction"] is not None) and yarns.outcome and cloth.outcome:
            found.setdefault((case["pattern"], case["direction"]), []).append((yarns, cloth))
    for runs in found.values():
        runs.sort(key=lambda pair: abs(pair[0].case["friction"] - options.friction))
    return found


def rendered(yarns: Kept, cloth: Kept) -> list[NDArray[np.uint8]]:
    """Both fabrics as pictures on one scale."""
    places = [run.end["positions"] for run in (yarns, cloth)]
    whole, ball = np.concatenate(places), yarns.case["ball"]
    found = []
    for woven in (True, False):
        with screen((PIXELS, PIXELS)) as plotter:
            light(plotter)
            if woven:
                lines = np.split(places[0], read_curve_frames(yarns.folder).curves.offsets[1:-1])
                curves = [Curve(line, k) for k, line in enumerate(lines)]
                mesh = tube_mesh(curves, yarns.case["radius"])
                plotter.add_mesh(mesh, scalars="colour", rgb=True, smooth_shading=True)
            else:
                triangles = read_cloth_frames(cloth.folder).triangles
                surface = pyvista.PolyData.from_regular_faces(places[1], triangles)
                back = {"color": theme.CLOTH_BACK}
                plotter.add_mesh(surface, color=theme.CLOTH_FRONT, backface_params=back, smooth_shading=True)
            if ball:
                centre, radius = ball
                plotter.add_mesh(pyvista.Sphere(center=centre, radius=radius), color=theme.OBSTACLE)
            aim(plotter, whole, camera=EYES[yarns.case["scene"]])
            found.append(plotter.screenshot(return_img=True))
    return found


def outlines(axes: Axes, yarns: Array, cloth: Array) -> None:
    """Silhouettes from above."""
    for pixels, colour in zip(silhouettes(yarns, cloth, "top"), (theme.SAMPLE, theme.FIT), strict=True):
        axes.contour(pixels.T.astype(float), levels=[0.5], colors=[colour], linewidths=1.2)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_box_aspect(1)


def side_by_side(options: argparse.Namespace, path: Path) -> None:
    """The picture of a scene."""
    found = chosen_pairs(options)
    with written_figure(path, WIDTH, 1.42 * len(options.patterns) + 0.3) as figure:
        panels = figure.subplots(len(options.patterns), 6, squeeze=False)
        for line, name in zip(panels, options.patterns, strict=True):
            for k, direction in enumerate(DIRECTIONS):
                for yarns, cloth in found.get((name, direction), [])[:1]:
                    for axes, image in zip(line[3 * k :], rendered(yarns, cloth), strict=False):
                        axes.imshow(image, interpolation="antialiased")
                    outlines(line[3 * k + 2], yarns.end["surface"], cloth.end["surface"])
            line[0].set_ylabel(name)
        for axes in panels.ravel():
            axes.set(xticks=[], yticks=[])
            axes.grid(False)
            for spine in axes.spines.values():
                spine.set_visible(False)
        for k, heading in enumerate(HEADINGS[options.scene]):
            for axes, column in zip(panels[0, 3 * k :], ("yarns", f"{heading}\ncloth", "outlines"), strict=False):
                axes.set_title(column, fontsize=8)
            for x, (word, colour) in enumerate((("yarns", theme.SAMPLE), ("cloth", theme.FIT))):
                panels[-1, 3 * k + 2].text(
                    0.2 + 0.6 * x, -0.08, word, color=colour, fontsize=7, ha="center", va="top",
                    transform=panels[-1, 3 * k + 2].transAxes,
                )  # fmt: skip
    # A few colours are enough, and a third of the bytes.
    Image.open(path).convert("RGB").quantize(COLOURS).save(path, optimize=True)


def forces(options: argparse.Namespace, path: Path) -> None:
    """Force of the bars over time, in all kept frictions."""
    found = chosen_pairs(options)
    with written_figure(path, WIDTH, 2.0) as figure:
        panels = figure.subplots(1, len(options.patterns), squeeze=False)[0]
        for axes, name in zip(panels, options.patterns, strict=True):
            for direction, dashes in zip(DIRECTIONS, ("-", "--"), strict=True):
                for k, (yarns, cloth) in enumerate(found.get((name, direction), [])):
                    drawn = [(yarns, theme.SAMPLE, f"yarns, {direction}")]
                    for run, colour, label in [
                        *drawn,
                        *([(cloth, theme.FIT, f"cloth, {direction}")] * (k == 0)),
                    ]:
                        axes.plot(
                            run.values("time"), run.values("pull"), dashes, color=colour, lw=1.5 / (1 + k),
                            label=label if k == 0 else None,
                        )  # fmt: skip
            axes.set(title=name, xlabel="time [s]")
        figure.axes[0].set_ylabel("force [N]")
        lines, labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(lines, labels, fontsize=7, loc="outside upper center", ncols=4)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("patterns", nargs="+")
    parser.add_argument("--scene", choices=tuple(EYES), default="stretch")
    parser.add_argument("--size", type=float, default=0.15)
    parser.add_argument("--friction", type=float, default=0.1)
    parser.add_argument("--cloth-friction", action="store_true", help="of cloth with the friction of the yarns")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--forces", type=Path)
    chosen = parser.parse_args()
    side_by_side(chosen, chosen.out)
    if chosen.forces is not None:
        forces(chosen, chosen.forces)

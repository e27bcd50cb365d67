"""All spline yarns, the published and the homogenized volume side by side: pictures, curves and a page (LOD03)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from yarnscale.arrays import Array
from yarnscale.fabric.spline_knit import SplineFabric
from yarnscale.files.animation import Animation, Moment
from yarnscale.files.curve_frames import CurveSet
from yarnscale.show import theme
from yarnscale.show.canvas import Camera, PicturesUnavailable
from yarnscale.show.plots import written_figure
from yarnscale.show.report import Picture, Section, Table, write_report
from yarnscale.show.run_page import frames_picture

TITLES = {"splines": "all yarns", "published": "published", "homogenized": "homogenized"}
"""What pictures call the models, by their names in options."""
_TILE, _POINTS = (560, 440), 3
_COLOURS = dict(zip(TITLES, (theme.INK, theme.FIT, theme.SAMPLE), strict=True))


@dataclass(eq=False)
class ModelPage:
    """``index.html`` in a folder: paragraphs, tables, and pictures that ``draw`` adds."""

    folder: Path
    title: str
    text: list[str] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)

    def draw(self, name: str, caption: str, write: Callable[[Path], None]) -> None:
        """Add a picture by a function of its path; where the machine cannot draw, a line that says so."""
        try:
            write(self.folder / name)
            self.pictures.append(Picture(self.folder / name, caption, wide=True))
        except PicturesUnavailable as error:
            self.pictures.append(Picture(None, f"{caption} No picture: {error}.", wide=True))

    def write(self) -> None:
        """Write the page."""
        write_report(self.folder / "index.html", self.title, [Section("Models", self.text, self.tables, self.pictures)])


def side_by_side(
    path: Path, fabric: SplineFabric, shapes: Sequence[Array], titles: Sequence[str], columns: int,
    camera: Camera | tuple[float, float, float] = "oblique",
) -> None:  # fmt: skip
    """Shapes of one fabric, by the control points of its yarns (n, 3) [m], at one scale in rows of ``columns``."""
    length = fabric.segments_per_yarn * _POINTS + 1
    curves = CurveSet(np.arange(fabric.yarn_count + 1) * length, fabric.radius)

    def moment(k: int) -> Moment:
        return Moment(float(k), yarns=fabric.lines(shapes[k], _POINTS).reshape(-1, 3), radii=curves.radii)

    drawn = Animation(np.arange(float(len(shapes))), moment, yarns=curves)
    frames_picture(path, drawn, columns=columns, camera=camera, size=_TILE, titles=titles)


def drop_curves(path: Path, times: Array, drops: Mapping[str, Mapping[str, Array]]) -> None:
    """``centre_drop`` and ``lower_edge_drop`` [m] of models over time [s]."""
    with written_figure(path, 8.4, 3.2) as figure:
        axes = figure.subplots(1, 2)
        for place, name, of in zip(axes, ("centre_drop", "lower_edge_drop"), ("centre", "lower edge"), strict=True):
            for model, fallen in drops.items():
                place.plot(times, 1e3 * fallen[name], ".-", color=_COLOURS[model], label=TITLES[model], markersize=4)
            place.set(xlabel="time [s]", ylabel=f"fall of the {of} [mm]")
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=len(drops))

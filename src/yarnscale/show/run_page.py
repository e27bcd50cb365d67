"""What a run leaves to look at: the last frame as OBJ, pictures of some moments, and a page with its numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from yarnscale.errors import InputError
from yarnscale.files.animation import Animation, read_animation
from yarnscale.files.obj import write_obj_frame
from yarnscale.motion.run import Run
from yarnscale.motion.unfulfilled import Unfulfilled
from yarnscale.show import theme
from yarnscale.show.canvas import Camera, PicturesUnavailable, write_png
from yarnscale.show.movie import Film
from yarnscale.show.report import Cell, Picture, Section, Table, write_report
from yarnscale.show.run_pane import run_pane

CAPTIONS = {"frames.png": "Moments of the run, bodies where they are.", "last.png": "At the end."}
UNITS = {
    "bar_force": "N", "force": "N", "speed": "m/s", "simulated_seconds": "s", "seconds": "s",
    **dict.fromkeys(("lowest", "highest", "closest", "centre_drop", "lower_edge_drop", "sag", "mean_sag"), "m"),
}  # fmt: skip
"""Of the numbers of a run that are no counts and no shares."""
_MOMENTS, _TILE = 6, (640, 500)
"""Moments of a picture at most, and the size of each [pixels]."""
View = Camera | tuple[float, float, float]


def write_run_page(
    folder: Path,
    title: str,
    run: Run,
    numbers: Mapping[str, object],
    *,
    frames: Path,
    text: Sequence[str] = (),
    camera: View = "oblique",
    material: object = None,
) -> None:
    """Write ``run_folder.PAGE`` into a folder from a run's frames; without pictures where the machine cannot draw.

    numbers: of the run, by name; those that are no plain values are left out. text: paragraphs. material: of a cloth.
    """
    animation = read_animation(frames)
    write_obj_frame(folder / "last.obj", animation, animation.moment(len(animation) - 1))
    try:
        draw_moments(folder, animation, camera)
        pictures = [Picture(folder / name, caption, True) for name, caption in CAPTIONS.items()]
    except PicturesUnavailable as error:
        pictures, text = [], [*text, f"No pictures: {error}."]
    try:
        pane = run_pane(animation, title, material=material, camera=camera)
        last = pictures.pop() if pictures else Picture(None)
        pictures.insert(0, replace(last, caption="The run; drag to turn.", wide=True, pane=pane))
    except InputError as error:
        text = [*text, f"No view that turns: {error}."]
    rows = [[f"{k} [{UNITS[k]}]" if k in UNITS else k, _cell(v)] for k, v in numbers.items() if _cell(v) is not None]
    tables = [Table(["", "value"], rows), *_unfulfilled(run.unfulfilled)]
    summary = f"Status: {run.outcome}{', motions not carried out' * bool(run.unfulfilled)}."
    section = Section("Results", text, tables, pictures)
    write_report(folder / "index.html", title, [section], summary=summary)


def draw_moments(folder: Path, animation: Animation, camera: View = "oblique") -> None:
    """``frames.png``: up to six moments side by side at one scale; ``last.png``: the last one, larger."""
    count = min(_MOMENTS, len(animation))
    chosen = [animation.numbers[round(k)] for k in np.linspace(0, len(animation) - 1, count)]
    frames_picture(folder / "frames.png", animation.among(chosen), camera=camera)
    frames_picture(folder / "last.png", animation.among(chosen[-1:]), camera=camera, size=theme.PICTURE_SIZE)


def frames_picture(
    path: Path, animation: Animation, *, columns: int = 3, camera: View = "oblique", size: tuple[int, int] = _TILE,
    titles: Sequence[str] = (),
) -> None:  # fmt: skip
    """All frames of an animation side by side at one scale, as a PNG file; size: of each [pixels]; titles: by frame."""
    with Film(animation, camera=camera, size=size, titles=titles) as film:
        tiles = [film.pixels(k) for k in range(len(animation))]
    columns = min(columns, len(tiles))
    tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % columns)
    write_png(path, np.concatenate([np.hstack(tiles[k : k + columns]) for k in range(0, len(tiles), columns)]))


def _cell(value: object) -> Cell:
    if value is None:
        return "not tested"
    return value if isinstance(value, str | int | float | bool) else None


def _unfulfilled(found: Sequence[Unfulfilled]) -> list[Table]:
    columns = ["not carried out", "first [s]", "off its place by up to [m]", "at the end [m]"]
    rows: list[list[Cell]] = [[entry.what, entry.first, entry.distance, entry.remaining] for entry in found]
    return [Table(columns, rows)] if rows else []

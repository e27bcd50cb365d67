"""One look for all pictures: colours that stay apart for colour-blind eyes, sizes, plot style."""

from __future__ import annotations

import numpy as np

from yarnscale.arrays import Array
from yarnscale.files.colours import YARNS

INK = "#22303c"
MUTED = "#6b7a88"
GRID = "#e3e8ec"
PAPER = "#ffffff"
FAINT = "#d4d9dd"
"""Periodic copies fade towards this grey."""

FIT = "#d9653b"
SAMPLE = "#2a6fa8"

CLOTH_FRONT = "#d98b5f"
CLOTH_BACK = "#4f7fa3"
OBSTACLE = "#c3cbd2"
SURFACE = "#7fb6d6"

SEQUENTIAL = "viridis"

PICTURE_SIZE = (1200, 900)
"""Width and height of a rendered picture [pixels]."""

PLOT_STYLE: dict[str, object] = {
    "figure.facecolor": PAPER,
    "figure.dpi": 150,
    "savefig.dpi": 150,
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.labelsize": 9.0,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": GRID,
    "grid.linewidth": 0.8,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "lines.linewidth": 1.8,
    "legend.frameon": False,
}
"""Settings for matplotlib's rc_context."""


def rgb(colour: str) -> Array:
    """Red, green and blue in [0, 1] of a colour written ``#rrggbb``, shape (3,)."""
    return np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0


def yarn_colour(yarn: int) -> Array:
    """Colour of a yarn by its number, shape (3,)."""
    return rgb(YARNS[yarn % len(YARNS)])


def faded(colour: Array) -> Array:
    """Colour moved by three quarters towards the grey of periodic copies, shape (3,)."""
    return 0.25 * colour + 0.75 * rgb(FAINT)

"""What the commands about yarns and cells take; imports nothing heavy."""

from __future__ import annotations

from pathlib import Path

from yarnscale.cli.shared_options import (
    PATTERN,
    YARN_MATERIAL,
    Add,
    add_as_drawn,
    add_cell_strain,
    add_free_sliding,
    add_json,
    add_overwrite,
    add_radius,
    add_starts,
    add_yarns,
)
from yarnscale.cli.values import size, sizes


def add_yarn_commands(add: Add) -> None:
    """Patterns, gallery, relax, study."""
    command = add("patterns", "yarns", "List the built-in patterns and yarn materials.")
    add_json(command)

    command = add("pattern", "yarns", "Write a built-in pattern or a chart, brought to rest, to a file.")
    command.add_argument("pattern", metavar="PATTERN", help=PATTERN)
    command.add_argument(
        "--out", type=Path, required=True, metavar="FILE.pyp", help=".pyp or .json file to write"
    )
    command.add_argument("--picture", type=Path, metavar="FILE.png", help="draw it too")
    command.add_argument(
        "--material", action="append", help=f"{YARN_MATERIAL}; the pattern is brought to rest with it"
    )
    add_as_drawn(command)
    add_radius(command)
    add_json(command)

    command = add("gallery", "gallery", "Write a page of patterns, each drawn, at rest and stretched.")
    command.add_argument(
        "patterns", nargs="*", metavar="PATTERN",
        help="names of built-in patterns and .chart files (default: all built-in ones)",
    )  # fmt: skip
    command.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder for the page and its pictures"
    )
    add_as_drawn(command)
    add_overwrite(command)
    add_json(command)

    command = add("relax", "yarns", "Relax a periodic cell under a macroscopic strain.")
    add_yarns(command)
    add_as_drawn(command)
    add_cell_strain(command)
    command.add_argument("--out", type=Path, metavar="STATE.npz", help="write positions, twist and edges")
    command.add_argument(
        "--picture", type=Path, metavar="FILE.png", help="draw the relaxed cell with its copies"
    )
    command.add_argument(
        "--size", type=size, default=(1, 1), metavar="NxM", help="relax N by M tiles as one cell (1x1)"
    )
    add_starts(command, default=1)
    add_free_sliding(command)
    add_json(command)

    command = add(
        "study", "study", "Compare cells of several sizes under one strain: energy, buckling, cost."
    )
    add_yarns(command)
    add_as_drawn(command)
    add_cell_strain(command)
    command.add_argument(
        "--sizes", type=sizes, default=[(1, 1), (2, 1), (1, 2), (2, 2)], metavar="1x1,2x1,2x2",
        help="numbers of tiles along x and y (1x1,2x1,1x2,2x2)",
    )  # fmt: skip
    add_starts(command, default=3)
    add_free_sliding(command)
    add_json(command)

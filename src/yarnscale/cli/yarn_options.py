"""What the commands about yarns and cells take; imports nothing heavy."""

from __future__ import annotations

from pathlib import Path

from yarnscale.cli.shared_options import Add
from yarnscale.cli.values import positive_integer, size, sizes


def add_yarn_commands(add: Add) -> None:
    """Patterns, gallery, relax, study."""
    add("patterns", "yarns", "List the built-in patterns, yarn materials and shell materials.", "--json")

    about = "Write a built-in pattern, chart or draft, brought to rest with its yarn, to a file."
    option = add("pattern", "yarns", about, "pattern", "--material", "--radius", "--as-drawn", "--json").add_argument
    option(
        "--out",
        type=Path,
        required=True,
        metavar="FILE.json",
        help=".json or .pyp file of its yarns, or .chart, .wif or .k file of its structure",
    )
    option("--picture", type=Path, metavar="FILE.png", help="draw it too")

    about = "Write a page of patterns, each drawn, at rest and stretched."
    option = add(
        "gallery", "gallery", about, "patterns", "--as-drawn", "--workers", "--overwrite", "--json"
    ).add_argument
    option("--out", type=Path, required=True, metavar="DIR", help="folder for the page and its pictures")

    cell = ("pattern", "--material", "--radius", "--as-drawn", "--strain", "--free-sliding", "--json")
    about = "Relax a periodic cell under a macroscopic strain."
    option = add("relax", "yarns", about, *cell, "--starts").add_argument
    option("--out", type=Path, metavar="STATE.npz", help="write the equilibrium and its pattern")
    option("--picture", type=Path, metavar="FILE.png", help="draw the relaxed cell with its copies")
    option("--size", type=size, default=(1, 1), metavar="NxM", help="relax N by M tiles as one cell (1x1)")

    about = "Compare cells of several sizes under one strain: energy, buckling, cost."
    option = add("study", "study", about, *cell).add_argument
    starts = "starts, all but one perturbed; the lowest energy counts (3)"
    option("--starts", type=positive_integer, default=3, metavar="N", help=starts)
    option(
        "--sizes", type=sizes, default=[(1, 1), (2, 1), (1, 2), (2, 2)], metavar="1x1,2x1,2x2",
        help="numbers of tiles along x and y (1x1,2x1,1x2,2x2)",
    )  # fmt: skip

"""What the commands about shell materials take; imports nothing heavy."""

from __future__ import annotations

from pathlib import Path

from yarnscale.cli.shared_options import PATTERN, SHELL, Add
from yarnscale.cli.values import number, number_list, numbers, size


def add_material_commands(add: Add) -> None:
    """Homogenize, sample, fit, export, evaluate, test."""
    running = ("--dask", "--workers", "--resume", "--overwrite", "--json")
    sampling = ("pattern", "--material", "--radius", "--as-drawn", "--solves", "--limit", *running)
    about = "From a yarn pattern to a shell material, with pictures and a page."
    option = add("homogenize", "materials", about, *sampling).add_argument
    option("--out", type=Path, required=True, metavar="DIR", help="folder for the results")
    friction = "coefficient of friction of yarns: the material remembers how it was loaded (the yarn's, else none)"
    option("--friction", type=number, metavar="MU", help=friction)
    visited = "sample where this simulation went, too; with --resume"
    option("--visited", type=Path, metavar="RUN", help=visited)
    option(
        "--form", choices=("compact", "hylc2020"), default="compact",
        help="one compact energy, sampled along loads, or the splines of HYLC20, sampled over strains (compact)",
    )  # fmt: skip
    stretch = "range of stretch of the form hylc2020 (-0.2,0.7)"
    option("--stretch", type=numbers(2, "LOW,HIGH"), metavar="LOW,HIGH", help=stretch)
    option("--shear", type=number, metavar="S", help="largest shear of the form hylc2020 (0.6)")
    curvature = "largest curvature of the form hylc2020 times yarn radius (0.1)"
    option("--curvature", type=number, metavar="C", help=curvature)
    option("--one-dimensional", action="store_true", help="no terms of two strains in the form hylc2020")
    smoothing = "width of the local polynomials that even out noise, over the distance of states (0.35)"
    option("--smoothing", type=number, metavar="W", help=smoothing)
    knots = "bending control points spaced evenly, not closer near zero"
    option("--even-knots", action="store_true", help=knots)

    about = "Relax a pattern along rays of loads, or under all states of a strain grid, into a store."
    option = add("sample", "samples", about, *sampling, "--free-sliding", "--starts").add_argument
    option("--out", type=Path, required=True, metavar="STORE", help="zarr store to write")
    grid = "strains instead of loads: arrays s_x, s_a, s_y, lambda_x, lambda_y"
    option("--grid", type=Path, metavar="GRID.toml", help=grid)
    option("--positions", action="store_true", help="store the vertices of every state too")
    moduli = "store the moduli of every state too, which takes twice as long"
    option("--moduli", action="store_true", help=moduli)
    option("--size", type=size, default=(1, 1), metavar="NxM", help="sample N by M tiles as one cell (1x1)")

    about = "Patterns in several yarns, each homogenized and tested: a folder of shell materials and a page of them."
    option = add("library", "library", about, "patterns", "--solves", *running).add_argument
    yarn = "yarn of all patterns, a preset or a TOML file; several times: every pattern in each of them (wool)"
    option("--material", action="append", metavar="YARN", help=yarn)
    option("--out", type=Path, required=True, metavar="DIR", help="folder with a folder for every material")

    option = add("fit", "samples", "Fit a shell material to a store of samples.", "--json").add_argument
    option("store", type=Path, metavar="STORE", help="store written by 'sample' or 'homogenize'")
    option("--out", type=Path, required=True, metavar="MATERIAL.json", help="material file to write")

    about = "Write a shell material for other programs: HYLC JSON, C or NVIDIA Warp source, Newton's cloth."
    option = add("export", "export", about, "material", "--json").add_argument
    form = "published layout, one C file, a function of NVIDIA Warp, or parameters of Newton's cloth with their errors"
    option("--format", "--to", choices=("hylc", "c", "warp", "newton"), required=True, help=form)
    option("--out", type=Path, required=True, metavar="FILE", help="file to write, .json, .c or .py")
    loads = "range of loads that Newton's cloth is fitted to [N/m] (0.05,5)"
    option("--loads", type=numbers(2, "LOW,HIGH"), metavar="LOW,HIGH", help=loads)

    about = "Energy density and stress of a shell material at a strain."
    option = add("evaluate", "materials", about, "material", "--json").add_argument
    option(
        "--strain", type=numbers(6, "sx,sa,sy,II11,II12,II22"), required=True, metavar="sx,sa,sy,II11,II12,II22",
        help="stretches and shear [-], second fundamental form [1/m]",
    )  # fmt: skip

    about = "Virtual tests of a fabric: tension, shear, bending, curl, drape; a page and numbers."
    option = add(
        "test", "laboratory", about, "--as-drawn", "--material", "--radius", "--overwrite", "--json"
    ).add_argument
    option("subject", metavar="SUBJECT", help=f"{PATTERN}; or a {SHELL}")
    option("--out", type=Path, required=True, metavar="DIR", help="folder for page and numbers")
    option("--against", metavar="OTHER", help="a second pattern or shell material to compare with")
    option(
        "--directions", type=number_list, default=(0.0, 45.0, 90.0), metavar="A,B,…",
        help="directions of pull from the course [degrees] (0,45,90)",
    )  # fmt: skip
    loads = "rising loads [N/m] (twelve from 0.02 to 50)"
    option("--loads", type=number_list, metavar="A,B,…", help=loads)
    curvatures = "of bending and twist [1/m] (to a tenth of the yarn's own)"
    option("--curvatures", type=number_list, metavar="A,B,…", help=curvatures)
    free = "let strips curl under tension (default: they stay flat)"
    option("--free-curvature", action="store_true", help=free)
    friction = "coefficient of friction of yarns: tension, shear and bending in cycles, and no other test"
    option("--friction", type=number, metavar="MU", help=friction)
    cycles = "cycles with friction (1), of yarns that have some or a shell material that 'homogenize --friction' made"
    option("--cycles", type=int, metavar="N", help=cycles)
    option("--drape", action="store_true", help="simulate the Cusick drape test (shell materials)")

"""What the commands about shell materials take; imports nothing heavy."""

from __future__ import annotations

from pathlib import Path

from yarnscale.cli.shared_options import (
    PATTERN,
    YARN_MATERIAL,
    Add,
    add_as_drawn,
    add_dask,
    add_free_sliding,
    add_json,
    add_overwrite,
    add_radius,
    add_starts,
    add_workers,
    add_yarns,
)
from yarnscale.cli.values import number, number_list, numbers, positive_integer, size


def add_material_commands(add: Add) -> None:
    """Homogenize, sample, fit, export, evaluate."""
    command = add(
        "homogenize", "materials", "From a yarn pattern to a shell material, with pictures and a page."
    )
    command.add_argument("pattern", metavar="PATTERN", help=PATTERN)
    command.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the results")
    command.add_argument("--material", action="append", help=YARN_MATERIAL)
    add_as_drawn(command)
    command.add_argument(
        "--solves", type=positive_integer, metavar="N", help="equilibria to sample (600; form hylc2020: 400)"
    )
    command.add_argument("--limit", type=float, metavar="N/M", help="largest load in N/m (50)")
    command.add_argument(
        "--visited", type=Path, metavar="RUN", help="sample where this simulation went, too; with --resume"
    )
    command.add_argument(
        "--form", choices=("compact", "hylc2020"), default="compact",
        help="one compact energy, sampled along loads, or the splines of HYLC20, sampled over strains (compact)",
    )  # fmt: skip
    published = command.add_argument_group("for the form hylc2020")
    published.add_argument(
        "--stretch", type=numbers(2, "LOW,HIGH"), metavar="LOW,HIGH", help="range of stretch (-0.2,0.7)"
    )
    published.add_argument("--shear", type=number, metavar="S", help="largest shear (0.6)")
    published.add_argument(
        "--curvature", type=number, metavar="C", help="largest curvature times yarn radius (0.1)"
    )
    published.add_argument("--one-dimensional", action="store_true", help="no terms of two strains")
    published.add_argument(
        "--smoothing",
        type=number,
        metavar="W",
        help="width of the local polynomials that even out noise, over the distance of states (0.35)",
    )
    published.add_argument(
        "--even-knots", action="store_true", help="bending control points spaced evenly, not closer near zero"
    )
    add_radius(command)
    add_dask(command)
    add_json(command)
    add_workers(command)
    add_overwrite(command)

    command = add(
        "sample",
        "samples",
        "Relax a pattern along rays of loads, or under all states of a strain grid, into a store.",
    )
    add_yarns(command)
    add_as_drawn(command)
    command.add_argument(
        "--grid", type=Path, metavar="GRID.toml",
        help="strains instead of loads: arrays s_x, s_a, s_y, lambda_x, lambda_y",
    )  # fmt: skip
    command.add_argument(
        "--solves", type=positive_integer, metavar="N", help="equilibria along rays of loads (600)"
    )
    command.add_argument("--limit", type=float, metavar="N/M", help="largest load in N/m (50)")
    command.add_argument("--out", type=Path, required=True, metavar="STORE", help="zarr store to write")
    command.add_argument("--positions", action="store_true", help="store the vertices of every state too")
    command.add_argument(
        "--moduli", action="store_true", help="store the moduli of every state too, which takes twice as long"
    )
    add_free_sliding(command)
    command.add_argument(
        "--size", type=size, default=(1, 1), metavar="NxM", help="sample N by M tiles as one cell (1x1)"
    )
    add_starts(command, default=1)
    add_dask(command)
    add_json(command)
    add_workers(command)
    add_overwrite(command)

    command = add("fit", "samples", "Fit a shell material to a store of samples.")
    command.add_argument(
        "store", type=Path, metavar="STORE", help="store written by 'sample' or 'homogenize'"
    )
    command.add_argument(
        "--out", type=Path, required=True, metavar="MATERIAL.json", help="material file to write"
    )
    add_json(command)

    command = add(
        "export", "export", "Write a shell material for other programs: HYLC JSON, C or NVIDIA Warp source."
    )
    command.add_argument("material", type=Path, metavar="MATERIAL.json", help="ours or published HYLC JSON")
    command.add_argument(
        "--format",
        choices=("hylc", "c", "warp"),
        required=True,
        help="published layout, one C file, or a function of NVIDIA Warp",
    )
    command.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help="file to write, .json, .c or .py"
    )
    add_json(command)

    command = add("evaluate", "materials", "Energy density and stress of a shell material at a strain.")
    command.add_argument("material", type=Path, metavar="MATERIAL.json", help="ours or published HYLC JSON")
    command.add_argument(
        "--strain", type=numbers(6, "sx,sa,sy,II11,II12,II22"), required=True, metavar="sx,sa,sy,II11,II12,II22",
        help="stretches and shear [-], second fundamental form [1/m]",
    )  # fmt: skip
    add_json(command)

    command = add(
        "test", "laboratory", "Virtual tests of a fabric: tension, shear, bending, curl, drape; a page and numbers."
    )  # fmt: skip
    command.add_argument("subject", metavar="SUBJECT", help=f"{PATTERN}; or a shell material file (.json)")
    command.add_argument("--material", action="append", help=YARN_MATERIAL)
    command.add_argument(
        "--against", metavar="OTHER", help="a second pattern or shell material to compare with"
    )
    command.add_argument(
        "--directions", type=number_list, default=(0.0, 45.0, 90.0), metavar="A,B,…",
        help="directions of pull from the course [degrees] (0,45,90)",
    )  # fmt: skip
    command.add_argument(
        "--loads", type=number_list, metavar="A,B,…", help="rising loads [N/m] (twelve from 0.02 to 50)"
    )
    command.add_argument(
        "--curvatures", type=number_list, metavar="A,B,…",
        help="of bending and twist [1/m] (to a tenth of the yarn's own)",
    )  # fmt: skip
    command.add_argument(
        "--free-curvature",
        action="store_true",
        help="let strips curl under tension (default: they stay flat)",
    )
    command.add_argument(
        "--drape", action="store_true", help="simulate the Cusick drape test (shell materials)"
    )
    add_as_drawn(command)
    command.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for page and numbers")
    add_radius(command)
    add_overwrite(command)
    add_json(command)

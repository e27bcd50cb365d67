"""What ``estimate`` takes; imports nothing heavy."""

from __future__ import annotations

import argparse
from pathlib import Path

from yarnscale.cli.shared_options import Add
from yarnscale.cli.values import not_negative, positive, positive_integer, two_lengths

SOLVERS = ("sobol", "local", "paper")
SOLVES = 750
DIRECTIONS = ("weft", "bias", "warp")
FOLLOW = ("measured", "shell")
SHELLS = ("stiffening", "stvk")
UNITS = ("N/m", "N/5cm", "N", "cN/tex")
SHAPES = ("free", "drawn")


def _directions(text: str) -> tuple[str, ...]:
    names = tuple(part.strip() for part in text.split(","))
    if not set(names) <= set(DIRECTIONS):
        raise argparse.ArgumentTypeError(f"expected some of {', '.join(DIRECTIONS)}; found {text!r}")
    return names


def add_estimate_options(add: Add) -> None:
    """The command ``estimate``."""
    about = "Estimate the yarn of a fabric from measured swatches."
    running = ("--workers", "--resume", "--dask", "--overwrite", "--json")
    option = add("estimate", "estimate", about, "--radius", *running).add_argument
    option(
        "measurements",
        type=Path,
        metavar="MEASUREMENTS",
        help="TOML, CSV, XLSX or U3M file of a fabric's swatch tests, or a folder of such fabrics",
    )
    option(
        "--pattern", metavar="PATTERN",
        help="built-in pattern, or a .pyp, .json, .chart, .wif or .k file of the fabric's structure (default: the one "
        "that the fabric file names)",
    )  # fmt: skip
    option("--out", type=Path, required=True, metavar="DIR", help="folder for the report and the evaluations")
    option("--sample", metavar="NAME-PREFIX", help="the fabric, where a table holds several: how its name begins")
    option(
        "--swatch", type=two_lengths, metavar="LENGTHxWIDTH",
        help="distance of the clamps before the test and width of the swatch [mm], where a log leaves them out",
    )  # fmt: skip
    counted = "of the fabric at rest, which fixes its size; with"
    option("--wales", type=positive, metavar="PER_CM", help=f"{counted} --courses")
    option("--courses", type=positive, metavar="PER_CM", help=f"{counted} --wales")
    option("--loop-length", type=positive, metavar="MM", help="yarn in one stitch, which fixes the size")
    option("--tex", type=positive, metavar="TEX", help="mass of the yarn in g per 1000 m")
    option("--area-density", type=positive, metavar="G_PER_M2", help="mass of the fabric")
    option("--directions", type=_directions, metavar="weft,bias,warp", help="directions to fit (all measured)")
    option("--holdout", choices=DIRECTIONS, help="direction that is not fitted but predicted")
    option(
        "--solver", choices=SOLVERS, default="sobol",
        help="sobol: scattered starts, then Gauss-Newton; local: Gauss-Newton alone; paper: all as published, a "
        "swarm and COBYLA, with --follow shell, --shell-model stvk, --shape drawn and the published ranges (sobol)",
    )  # fmt: skip
    option("--seed", type=int, default=0, help="of the search (0)")
    option(
        "--follow", choices=FOLLOW, default="measured",
        help="what the yarn is fitted to: the measured curves without the effect of the clamps, or the fitted shell "
        "(measured)",
    )  # fmt: skip
    option(
        "--shell-model", choices=SHELLS, default="stiffening",
        help="shell between swatch and yarn: one that stiffens as fabric does, or St. Venant-Kirchhoff as published "
        "(stiffening)",
    )  # fmt: skip
    friction = "fit the friction of the yarns, too, from loading and unloading together; some minutes more"
    option("--fit-friction", action="store_true", help=friction)
    option(
        "--shape", choices=SHAPES,
        help="drawn: the pattern has the fabric's stitch density; free: its width over height and its tightness are "
        "estimated too (free for built-in patterns and charts, drawn for files of yarn geometry)",
    )  # fmt: skip
    option(
        "--yarn-length", type=positive, metavar="METRES",
        help="yarn in one period of the pattern (default: of the pattern as drawn, 0.4 mm yarn for built-in patterns)",
    )  # fmt: skip
    option(
        "--stiffness", type=positive, metavar="NEWTON",
        help="of the stiffest yarn, k_s2 (default: from the measurements, else an estimate of 60 N)",
    )  # fmt: skip
    option(
        "--homogenize", type=positive_integer, nargs="?", const=SOLVES, metavar="N",
        help="homogenize the estimated yarn with about N equilibria (750), simulate the swatches as cloth of it, and "
        "compare them with the measured ones",
    )  # fmt: skip
    option("--units", choices=UNITS, default="N/m", help="of loads in the report; cN/tex by the fabric's mass (N/m)")
    option("--starts", type=positive_integer, default=64, metavar="N", help="scattered yarns (64)")
    refined = "from how many of the best refinement begins (8)"
    option("--refined", type=positive_integer, default=8, metavar="N", help=refined)
    option("--iterations", type=positive_integer, default=20, metavar="N", help="of Gauss-Newton, at most (20)")
    option(
        "--bending-weight", type=not_negative, default=0.0, metavar="W",
        help="of the bending stiffness measured with pear loops, beside 1 of stress and 1 of contraction (0)",
    )  # fmt: skip

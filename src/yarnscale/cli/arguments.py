"""What the commands take; imports nothing heavy, so that ``--help`` answers at once."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import NoReturn

from yarnscale import __version__
from yarnscale.cli.estimate_options import add_estimate_options
from yarnscale.cli.fabric_options import add_fabric_options


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line; the usage is a ``--help`` away."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


def _deferred(module: str, function: str) -> Callable[[argparse.Namespace], int]:
    def run(options: argparse.Namespace) -> int:
        return getattr(import_module(f"yarnscale.cli.{module}"), function)(options)

    return run


def numbers(count: int, names: str) -> Callable[[str], tuple[float, ...]]:
    """A parser of ``count`` finite numbers with commas between them."""

    def parse(text: str) -> tuple[float, ...]:
        try:
            values = tuple(float(part) for part in text.split(","))
        except ValueError:
            values = ()
        if len(values) != count or not all(math.isfinite(v) for v in values):
            raise argparse.ArgumentTypeError(f"expected {count} numbers {names}; found {text!r}")
        return values

    return parse


def _positive_integer(text: str) -> int:
    try:
        value = int(text)
    except ValueError:
        value = 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"expected a positive whole number; found {text!r}")
    return value


def _size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"([1-9]\d{0,3})x([1-9]\d{0,3})", text.strip())
    if match is None:
        raise argparse.ArgumentTypeError(f"expected numbers of tiles such as 2x1; found {text!r}")
    return int(match[1]), int(match[2])


def _sizes(text: str) -> list[tuple[int, int]]:
    return [_size(part) for part in text.split(",")]


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"expected a number; found {text!r}")
    return value


def _positive(text: str) -> float:
    value = _number(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"expected a positive number; found {text!r}")
    return value


def parser() -> argparse.ArgumentParser:
    """The whole command line."""
    top = _Parser(prog="yarnscale", description="Knitted and woven cloth across scales.")
    top.add_argument("--version", action="version", version=f"yarnscale {__version__}")
    commands = top.add_subparsers(title="commands", dest="command", required=True, metavar="COMMAND")

    def add(name: str, module: str, about: str) -> argparse.ArgumentParser:
        command = commands.add_parser(name, help=about, description=about)
        command.set_defaults(run=_deferred(module, name))
        return command

    _yarn_commands(add)
    _material_commands(add)
    _cloth_commands(add)
    return top


_Add = Callable[[str, str, str], argparse.ArgumentParser]
_PATTERN = "name of a built-in pattern (see 'yarnscale patterns'), or a .pyp, .json or .chart file"
_MATERIAL = (
    "yarn material: a preset or a TOML file (default: the one that suits the built-in pattern of that name, "
    "else hylc2020-stockinette); repeat it to give each of the pattern's materials, in their order"
)


def _yarn_commands(add: _Add) -> None:
    command = add("patterns", "yarns", "List the built-in patterns and yarn materials.")
    command.add_argument("--json", action="store_true", help="print one JSON object")

    command = add("pattern", "yarns", "Write a built-in pattern, relaxed to its rest shape, to a file.")
    command.add_argument("name", metavar="NAME", help="name of a built-in pattern")
    command.add_argument(
        "--out", type=Path, required=True, metavar="FILE.pyp", help=".pyp or .json file to write"
    )
    command.add_argument("--picture", type=Path, metavar="FILE.png", help="draw it too")
    command.add_argument("--material", action="append", help=f"{_MATERIAL}; the pattern is relaxed with it")
    command.add_argument("--as-drawn", action="store_true", help="write the drawing as it is, not relaxed")
    command.add_argument("--radius", type=_number, help="yarn radius [m]")

    command = add(
        "gallery", "gallery", "Write a page of built-in patterns, each drawn, at rest and stretched."
    )
    command.add_argument("names", nargs="*", metavar="NAME", help="names of built-in patterns (default: all)")
    command.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder for the page and its pictures"
    )
    command.add_argument(
        "--as-drawn",
        action="store_true",
        help="stretch the drawings as they are; faster than bringing them to rest",
    )
    command.add_argument("--json", action="store_true", help="print one JSON object")

    command = add("relax", "yarns", "Relax a periodic cell under a macroscopic strain.")
    command.add_argument("pattern", metavar="PATTERN", help=_PATTERN)
    command.add_argument("--material", action="append", help=_MATERIAL)
    command.add_argument(
        "--strain", type=numbers(5, "sx,sa,sy,lx,ly"), default=(0.0,) * 5, metavar="sx,sa,sy,lx,ly",
        help="stretch along x, shear, stretch along y [-], curvature along x, along y [1/m]",
    )  # fmt: skip
    command.add_argument("--out", type=Path, metavar="STATE.npz", help="write positions, twist and edges")
    command.add_argument(
        "--picture", type=Path, metavar="FILE.png", help="draw the relaxed cell with its copies"
    )
    command.add_argument(
        "--size", type=_size, default=(1, 1), metavar="NxM", help="relax N by M tiles as one cell (1x1)"
    )
    command.add_argument(
        "--starts", type=_positive_integer, default=1, metavar="N",
        help="starts, all but one perturbed; the lowest energy counts (1)",
    )  # fmt: skip
    command.add_argument(
        "--free-sliding", action="store_true", help="let yarns slide along themselves as a whole"
    )
    command.add_argument("--json", action="store_true", help="print one JSON object")

    command = add(
        "study", "study", "Compare cells of several sizes under one strain: energy, buckling, cost."
    )
    command.add_argument("pattern", metavar="PATTERN", help=_PATTERN)
    command.add_argument("--material", action="append", help=_MATERIAL)
    command.add_argument(
        "--strain", type=numbers(5, "sx,sa,sy,lx,ly"), default=(0.0,) * 5, metavar="sx,sa,sy,lx,ly",
        help="stretch along x, shear, stretch along y [-], curvature along x, along y [1/m]",
    )  # fmt: skip
    command.add_argument(
        "--sizes", type=_sizes, default=[(1, 1), (2, 1), (1, 2), (2, 2)], metavar="1x1,2x1,2x2",
        help="numbers of tiles along x and y (1x1,2x1,1x2,2x2)",
    )  # fmt: skip
    command.add_argument(
        "--starts", type=_positive_integer, default=3, metavar="N",
        help="starts of each size, all but one perturbed; the lowest energy counts (3)",
    )  # fmt: skip
    command.add_argument(
        "--free-sliding", action="store_true", help="let yarns slide along themselves as a whole"
    )
    command.add_argument("--json", action="store_true", help="print one JSON object")


def _workers(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--workers", type=_positive_integer, metavar="N", help="processes (default: one per core)"
    )
    command.add_argument("--resume", action="store_true", help="go on where an interrupted run stopped")


def _in_plane(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--in-plane",
        choices=("pairwise", "full"),
        default="full",
        help="terms of pairs of strains only, as HYLC20, or of all three in-plane strains together too (full)",
    )


def _material_commands(add: _Add) -> None:
    command = add(
        "homogenize", "materials", "From a yarn pattern to a shell material, with pictures and a page."
    )
    command.add_argument("pattern", metavar="PATTERN", help=_PATTERN)
    command.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the results")
    command.add_argument("--material", action="append", help=_MATERIAL)
    command.add_argument(
        "--as-drawn", action="store_true",
        help="sample a built-in pattern or chart as it is drawn, not as fabric at rest",
    )  # fmt: skip
    command.add_argument(
        "--solves", type=_positive_integer, default=400, metavar="N", help="states to sample (400)"
    )
    command.add_argument(
        "--budget", type=_positive_integer, metavar="N",
        help="then solve more states where the fit errs most, up to N in all (default: none)",
    )  # fmt: skip
    command.add_argument(
        "--target-error", type=_number, metavar="E",
        help="stop before the budget where 95 %% of the energies are estimated to err by less, as a fraction of the "
        "largest, e.g. 0.005",
    )  # fmt: skip
    command.add_argument(
        "--stretch", type=numbers(2, "LOW,HIGH"), metavar="LOW,HIGH", help="range of stretch (-0.2,0.7)"
    )
    command.add_argument("--shear", type=_number, metavar="S", help="largest shear (0.6)")
    command.add_argument(
        "--curvature", type=_number, metavar="C", help="largest curvature times yarn radius (0.1)"
    )
    _in_plane(command)
    _workers(command)

    command = add("sample", "samples", "Relax a pattern under all states of a strain grid, into a store.")
    command.add_argument("pattern", metavar="PATTERN", help=_PATTERN)
    command.add_argument("--material", action="append", help=_MATERIAL)
    command.add_argument(
        "--grid",
        type=Path,
        required=True,
        metavar="GRID.toml",
        help="arrays s_x, s_a, s_y, lambda_x, lambda_y",
    )
    command.add_argument("--out", type=Path, required=True, metavar="STORE", help="zarr store to write")
    command.add_argument("--positions", action="store_true", help="store the vertices of every state too")
    command.add_argument(
        "--free-sliding", action="store_true", help="let yarns slide along themselves as a whole"
    )
    command.add_argument(
        "--size", type=_size, default=(1, 1), metavar="NxM", help="sample N by M tiles as one cell (1x1)"
    )
    command.add_argument(
        "--starts", type=_positive_integer, default=1, metavar="N",
        help="starts of every state, all but one perturbed; the lowest energy counts (1)",
    )  # fmt: skip
    command.add_argument("--dask", metavar="ADDRESS", help="scheduler of a Dask cluster, host:port")
    command.add_argument("--json", action="store_true", help="print one JSON object")
    _workers(command)

    command = add("fit", "samples", "Fit a shell material to a store of samples.")
    command.add_argument(
        "store", type=Path, metavar="STORE", help="store written by 'sample' or 'homogenize'"
    )
    command.add_argument(
        "--out", type=Path, required=True, metavar="MATERIAL.json", help="material file to write"
    )
    _in_plane(command)

    command = add("export", "export", "Write a shell material for other programs: HYLC JSON or C source.")
    command.add_argument("material", type=Path, metavar="MATERIAL.json", help="ours or published HYLC JSON")
    command.add_argument(
        "--format", choices=("hylc", "c"), required=True, help="published layout, or one C file"
    )
    command.add_argument("--out", type=Path, required=True, metavar="FILE", help="file to write, .json or .c")

    command = add("evaluate", "materials", "Energy density and stress of a shell material at a strain.")
    command.add_argument("material", type=Path, metavar="MATERIAL.json", help="ours or published HYLC JSON")
    command.add_argument(
        "--strain", type=numbers(6, "sx,sa,sy,II11,II12,II22"), required=True, metavar="sx,sa,sy,II11,II12,II22",
        help="stretches and shear [-], second fundamental form [1/m]",
    )  # fmt: skip
    command.add_argument("--json", action="store_true", help="print one JSON object")


def _cloth_commands(add: _Add) -> None:
    command = add("stretch", "cloth", "Stretch a 30 × 30 cm sheet between two bars.")
    command.add_argument("material", type=Path, metavar="MATERIAL.json", help="shell material")
    command.add_argument(
        "--direction", choices=("course", "wale"), required=True, help="direction of the pull"
    )
    command.add_argument(
        "--amount", type=_number, help="growth of the bars' distance, e.g. 0.373; or give --travel"
    )
    command.add_argument(
        "--travel", type=_number, metavar="M",
        help="way of each bar [m]; published: 0.035 stockinette, 0.02 basket, 0.04 rib",
    )  # fmt: skip
    command.add_argument(
        "--duration", type=_positive, metavar="S", help="of the pull [s] (as published: 0.05 + way / 0.1 m/s)"
    )
    command.add_argument("--air-drag", type=_number, metavar="D", help="[kg/m³], quadratic (10)")
    command.add_argument(
        "--spacing", type=_positive, metavar="H", help="edge length of triangles [m] (0.0065)"
    )
    _cloth_output(command)

    command = add("drape", "cloth", "Drape a 30 × 30 cm sheet over a sphere.")
    command.add_argument("material", type=Path, metavar="MATERIAL.json", help="shell material")
    command.add_argument(
        "--spacing", type=_positive, metavar="H", help="edge length of triangles [m] (0.0065)"
    )
    _cloth_output(command)

    command = add("simulate", "cloth", "Simulate a scene file, or a ready scene such as the sweater.")
    command.add_argument(
        "scene",
        metavar="SCENE",
        help="scene file (.toml, see docs/scene_format.md) or: stretch-course, stretch-wale, drape, drape-on-ball, "
        "hang, twist, ring, scarf, tshirt, sweater",
    )
    command.add_argument(
        "--material", type=Path, metavar="MATERIAL.json", help="shell material of a ready scene"
    )
    command.add_argument(
        "--spacing", type=_number, metavar="H", help="edge length of the triangles of a ready scene [m]"
    )
    _cloth_output(command)

    command = add(
        "detail", "detail", "Put the relaxed yarns of a pattern on the frames of a simulated cloth."
    )
    command.add_argument(
        "frames", type=Path, metavar="DIR", help="folder that 'simulate' wrote, or one of frames"
    )
    command.add_argument("--pattern", required=True, metavar="PATTERN", help=_PATTERN)
    command.add_argument("--material", action="append", help=_MATERIAL)
    command.add_argument(
        "--samples", type=Path, metavar="STORE",
        help="grid that 'sample' wrote (default: one of 1225 states, made once beside the yarns)",
    )  # fmt: skip
    command.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for frames of curves (default: DIR/yarns)"
    )
    command.add_argument("--picture", type=Path, metavar="FILE.png", help="draw the last frame's yarns")
    command.add_argument("--json", action="store_true", help="print one JSON object")
    _workers(command)

    command = add("convert", "convert", "Convert the frames of a run: OBJ, glTF, USD, VTK, BCC, MP4, PNG.")
    command.add_argument(
        "frames", type=Path, metavar="DIR", help="folder that 'simulate' wrote, or one of frames"
    )
    command.add_argument(
        "--to", choices=("obj", "gltf", "usd", "vtk", "bcc", "mp4", "png"), required=True,
        help="format, see docs/output_formats.md",
    )  # fmt: skip
    command.add_argument(
        "--out", type=Path, required=True, metavar="PATH",
        help="file .glb, .usdc, .usda, .pvd or .mp4; folder for obj, bcc and png",
    )  # fmt: skip
    command.add_argument(
        "--yarns", type=Path, metavar="DIR", help="frames of yarn curves to go with the cloth"
    )
    command.add_argument("--fps", type=_positive, default=30.0, help="frames a second of USD and MP4 (30)")
    command.add_argument("--speed", type=_positive, default=1.0, help="of an MP4, 1 is real time (1)")
    command.add_argument(
        "--colour", choices=("sides", "stretch"), default="sides", help="of cloth in MP4 and PNG (sides)"
    )
    command.add_argument(
        "--camera", choices=("oblique", "top", "side"), default="oblique", help="of MP4 and PNG (oblique)"
    )
    command.add_argument("--wires", action="store_true", help="draw the edges of triangles in MP4 and PNG")
    command.add_argument(
        "--yarns-as", choices=("tubes", "lines"), default="tubes", help="in glTF, which has no curves (tubes)"
    )

    command = add("fabric", "fabric", "Simulate a finite fabric, yarn by yarn or in a bounding volume.")
    add_fabric_options(command)

    command = add("estimate", "estimate", "Estimate the yarn of a fabric from measured swatches.")
    add_estimate_options(command)

    command = add("demo", "demo", "Run the whole first job on a built-in pattern, with pictures and a page.")
    command.add_argument(
        "--out", type=Path, default=Path("demo"), metavar="DIR", help="folder for the page (demo)"
    )


def _cloth_output(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder for frames and pictures"
    )
    command.add_argument(
        "--resume", action="store_true", help="go on from the last frame of a run that was interrupted"
    )
    command.add_argument(
        "--animation", action="store_true",
        help="the motion alone, with bounded work a step: steps of 1/30 s that need not converge",
    )  # fmt: skip
    command.add_argument(
        "--format", action="append", choices=("obj", "gltf", "usd", "vtk", "mp4", "png"), default=[],
        help="convert the frames at the end; may be given several times",
    )  # fmt: skip
    command.add_argument("--json", action="store_true", help="print one JSON object")

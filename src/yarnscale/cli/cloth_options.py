"""What the commands about cloth and its frames take; imports nothing heavy."""

from __future__ import annotations

import argparse
from pathlib import Path

from yarnscale.cli.shared_options import (
    PATTERN,
    YARN_MATERIAL,
    Add,
    add_dask,
    add_json,
    add_overwrite,
    add_radius,
    add_resume,
    add_workers,
)
from yarnscale.cli.values import frames, number, positive

_FRAMES = "frames to take, both ends included, e.g. 10:40:2, 30 or -1 (default: all)"


def add_cloth_commands(add: Add) -> None:
    """Stretch, drape, simulate, detail, convert."""
    command = add("stretch", "cloth", "Stretch a 30 × 30 cm sheet between two bars.")
    command.add_argument("material", type=Path, metavar="MATERIAL.json", help="shell material")
    command.add_argument(
        "--direction", choices=("course", "wale"), required=True, help="direction of the pull"
    )
    command.add_argument(
        "--amount", type=number, help="growth of the bars' distance, e.g. 0.373; or give --travel"
    )
    command.add_argument(
        "--travel", type=number, metavar="M",
        help="way of each bar [m]; published: 0.035 stockinette, 0.02 basket, 0.04 rib",
    )  # fmt: skip
    command.add_argument(
        "--duration", type=positive, metavar="S", help="of the pull [s] (as published: 0.05 + way / 0.1 m/s)"
    )
    command.add_argument("--air-drag", type=number, metavar="D", help="[kg/m³], quadratic (10)")
    command.add_argument(
        "--spacing", type=positive, metavar="H", help="edge length of triangles [m] (0.0065)"
    )
    _add_output(command)

    command = add("drape", "cloth", "Drape a 30 × 30 cm sheet over a sphere.")
    command.add_argument("material", type=Path, metavar="MATERIAL.json", help="shell material")
    command.add_argument(
        "--spacing", type=positive, metavar="H", help="edge length of triangles [m] (0.0065)"
    )
    _add_output(command)

    command = add("simulate", "cloth", "Simulate a scene file, or a ready scene such as the sweater.")
    command.add_argument(
        "scene",
        metavar="SCENE",
        help="scene file (.toml, see yarnscale help scene) or: stretch-course, stretch-wale, drape, drape-on-ball, "
        "hang, twist, ring, scarf, tshirt, sweater",
    )
    command.add_argument(
        "--material", type=Path, metavar="MATERIAL.json", help="shell material of a ready scene"
    )
    command.add_argument(
        "--spacing", type=number, metavar="H", help="edge length of the triangles of a ready scene [m]"
    )
    _add_output(command)

    command = add(
        "detail", "detail", "Put the relaxed yarns of a pattern on the frames of a simulated cloth."
    )
    command.add_argument(
        "frames", type=Path, metavar="DIR", help="folder that 'simulate' wrote, or one of frames"
    )
    command.add_argument("--pattern", required=True, metavar="PATTERN", help=PATTERN)
    command.add_argument("--material", action="append", help=YARN_MATERIAL)
    command.add_argument(
        "--samples", type=Path, metavar="STORE",
        help="store that 'sample' or 'homogenize' wrote (default: 'samples' beside the pattern file, else a grid of "
        "1225 states that is relaxed once and kept beside the yarns)",
    )  # fmt: skip
    command.add_argument(
        "--relaxed",
        action="store_true",
        help="relax that grid even where there are samples: slow, more exact",
    )
    command.add_argument("--frames", dest="chosen", type=frames, metavar="FIRST:LAST:STEP", help=_FRAMES)
    command.add_argument(
        "--seams", choices=("joined", "cut"), default="joined",
        help="yarns at seams: joined (default) goes on with the pattern where it can, and bridges where it cannot",
    )  # fmt: skip
    command.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for frames of curves (default: DIR/yarns)"
    )
    command.add_argument("--picture", type=Path, metavar="FILE.png", help="draw the last frame's yarns")
    add_radius(command)
    add_dask(command)
    add_json(command)
    add_overwrite(command)
    add_workers(command)

    command = add("convert", "convert", "Convert the frames of a run: OBJ, glTF, USD, VTK, BCC, MP4, PNG.")
    command.add_argument(
        "frames", type=Path, metavar="DIR", help="folder that 'simulate' wrote, or one of frames"
    )
    command.add_argument(
        "--to", choices=("obj", "gltf", "usd", "vtk", "bcc", "mp4", "png"), required=True,
        help="format, see yarnscale help output_formats",
    )  # fmt: skip
    command.add_argument(
        "--out", type=Path, required=True, metavar="PATH",
        help="file .glb, .usdc, .usda, .pvd or .mp4; folder for obj, bcc and png",
    )  # fmt: skip
    command.add_argument(
        "--yarns", type=Path, metavar="DIR", help="frames of yarn curves to go with the cloth"
    )
    command.add_argument(
        "--frames", dest="chosen", type=frames, metavar="FIRST:LAST:STEP",
        help=f"{_FRAMES}; of glTF with tubes the last one",
    )  # fmt: skip
    command.add_argument(
        "--size", type=positive, default=50.0, metavar="MB",
        help="of a frame of tubes in glTF, which get fewer sides and points until they fit (50)",
    )  # fmt: skip
    add_json(command)
    command.add_argument("--fps", type=positive, default=30.0, help="frames a second of USD and MP4 (30)")
    command.add_argument("--speed", type=positive, default=1.0, help="of an MP4, 1 is real time (1)")
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
    add_overwrite(command)


def _add_output(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder for frames and pictures"
    )
    add_resume(command)
    command.add_argument(
        "--animation", action="store_true",
        help="the motion alone, with bounded work a step: steps of 1/30 s that need not converge",
    )  # fmt: skip
    command.add_argument(
        "--format", action="append", choices=("obj", "gltf", "usd", "vtk", "mp4", "png"), default=[],
        help="convert the frames at the end; may be given several times",
    )  # fmt: skip
    add_overwrite(command)
    add_json(command)

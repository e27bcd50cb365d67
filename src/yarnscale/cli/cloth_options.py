"""What the commands about cloth and its frames take; imports nothing heavy."""

from __future__ import annotations

from pathlib import Path

from yarnscale.cli.shared_options import PATTERN, SHELL, Add
from yarnscale.cli.values import frames, number, positive

_FRAMES = "frames to take, both ends included, e.g. 10:40:2, 30 or -1 (default: all)"
KINDS = ("obj", "gltf", "usd", "vtk", "mp4", "png")
_RUN = "folder that 'simulate' wrote, or one of frames"


def add_cloth_commands(add: Add) -> None:
    """Stretch, drape, simulate, detail, convert."""
    run = ("--resume", "--overwrite", "--json")
    stretch = add("stretch", "cloth", "Stretch a 30 × 30 cm sheet between two bars.", "material", *run)
    drape = add("drape", "cloth", "Drape a 30 × 30 cm sheet over a sphere.", "material", *run)
    simulate = add("simulate", "cloth", "Simulate a scene file, or a ready scene such as the sweater.", *run)
    for option in (stretch.add_argument, drape.add_argument):
        option("--spacing", type=positive, metavar="H", help="edge length of triangles [m] (0.0065)")
    for option in (stretch.add_argument, drape.add_argument, simulate.add_argument):
        option("--out", type=Path, required=True, metavar="DIR", help="folder for frames and pictures")
        bounded = "the motion alone, with bounded work a step: steps of 1/30 s that need not converge"
        option("--animation", action="store_true", help=bounded)
        several = "convert the frames at the end; may be given several times"
        option("--format", action="append", choices=KINDS, default=[], help=several)

    option = stretch.add_argument
    option("--direction", choices=("course", "wale"), required=True, help="direction of the pull")
    option("--amount", type=number, help="growth of the bars' distance, e.g. 0.373; or give --travel")
    travel = "displacement of each bar [m]; published: 0.035 stockinette, 0.02 basket, 0.04 rib"
    option("--travel", type=number, metavar="M", help=travel)
    duration = "of the pull [s] (as published: 0.05 + way / 0.1 m/s)"
    option("--duration", type=positive, metavar="SECONDS", help=duration)
    option("--air-drag", type=number, metavar="D", help="[kg/m³], quadratic (10)")

    option = simulate.add_argument
    option(
        "scene", metavar="SCENE",
        help="scene file (.toml, see yarnscale help scene) or: stretch-course, stretch-wale, drape, drape-on-ball, "
        "hang, bagging, twist, ring, scarf, tshirt, sweater",
    )  # fmt: skip
    option("--shell", metavar="SHELL", help=f"of a ready scene, {SHELL}")
    option("--spacing", type=positive, metavar="H", help="edge length of the triangles of a ready scene [m]")

    about = "Put the relaxed yarns of a pattern on the frames of a simulated cloth."
    yarn = ("--material", "--radius", "--dask", "--workers", "--resume", "--overwrite", "--json")
    option = add("detail", "detail", about, *yarn).add_argument
    option("frames", type=Path, metavar="DIR", help=_RUN)
    option("--pattern", required=True, metavar="PATTERN", help=PATTERN)
    option(
        "--samples", type=Path, metavar="STORE",
        help="store that 'sample' or 'homogenize' wrote (default: 'samples' beside the pattern file, else a grid of "
        "1225 states that is relaxed once and kept beside the yarns)",
    )  # fmt: skip
    relaxed = "relax that grid even where there are samples: slow, more exact"
    option("--relaxed", action="store_true", help=relaxed)
    option("--frames", dest="chosen", type=frames, metavar="FIRST:LAST:STEP", help=_FRAMES)
    option(
        "--seams", choices=("joined", "cut"), default="joined",
        help="yarns at seams: joined (default) continues the pattern where it can, with bridges where it cannot",
    )  # fmt: skip
    option("--out", type=Path, metavar="DIR", help="folder for frames of curves (default: DIR/yarns)")
    option("--picture", type=Path, metavar="FILE.png", help="draw the last frame's yarns")

    about = "Convert the frames of a run: OBJ, glTF, USD, VTK, BCC, MP4, PNG."
    option = add("convert", "convert", about, "--overwrite", "--json").add_argument
    option("frames", type=Path, metavar="DIR", help=_RUN)
    option("--format", "--to", choices=(*KINDS, "bcc"), required=True, help="see yarnscale help output_formats")
    out = "file .glb, .usdc, .usda, .pvd or .mp4; folder for obj, bcc and png"
    option("--out", type=Path, required=True, metavar="PATH", help=out)
    option("--yarns", type=Path, metavar="DIR", help="frames of yarn curves to go with the cloth")
    tubes = f"{_FRAMES}; of glTF with tubes the last one"
    option("--frames", dest="chosen", type=frames, metavar="FIRST:LAST:STEP", help=tubes)
    size = "of a frame of tubes in glTF, which get fewer sides and points until they fit (50)"
    option("--megabytes", type=positive, default=50.0, metavar="MB", help=size)
    option("--fps", type=positive, default=30.0, help="frames a second of USD and MP4 (30)")
    option("--speed", type=positive, default=1.0, help="of an MP4, 1 is real time (1)")
    colour = "of cloth in MP4 and PNG (sides)"
    option("--colour", choices=("sides", "stretch"), default="sides", help=colour)
    camera = "of MP4 and PNG (oblique)"
    option("--camera", choices=("oblique", "top", "side"), default="oblique", help=camera)
    option("--wires", action="store_true", help="draw the edges of triangles in MP4 and PNG")
    yarns_as = "in glTF, which has no curves (tubes)"
    option("--yarns-as", choices=("tubes", "lines"), default="tubes", help=yarns_as)

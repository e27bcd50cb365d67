"""What ``fabric`` takes; imports nothing heavy."""

from __future__ import annotations

import argparse
from pathlib import Path

from yarnscale.cli.shared_options import Add
from yarnscale.cli.values import not_negative, number, positive, whole

SCENES = ("hang", "stretch", "drape")
COMPARED = ("hang", "imposed")
"""Scenes of ``--method compare``."""
IN_SCENE_FILES = ("amount", "direction", "ball_friction", "duration", "time_step", "damping")
"""Options that a scene file replaces."""
OF_SCENES = {"stretch": ("amount", "direction"), "drape": ("ball_friction",)}
"""Options that one ready scene alone has."""
ONLY_RODS = ("border", "on", "tube", "as_drawn", "friction")
"""Options that spline yarns do not have."""
SHAPING = (
    "rows", "columns", "method", "model", "volume", "reduction", "adaptive", "scene", "unit", "weld", "tube", "border",
    "as_drawn", "amount", "direction", "friction", "ball_friction", "explicit", "integrator", "damping", "duration",
    "time_step",
)  # fmt: skip
"""Options that decide how a fabric moves."""


def _volume(text: str) -> tuple[int, int]:
    parts = text.split(",")
    if len(parts) != 3 or not all(part.strip().isdigit() for part in parts) or int(parts[2]) != 2:
        raise argparse.ArgumentTypeError(f"expected control points n1,n2,2 such as 5,5,2; found {text!r}")
    return int(parts[0]), int(parts[1])


_count = whole("a whole number from 2 to 1000", 2, 1000)


def _weld(text: str) -> bool | float:
    return text == "yes" if text in ("yes", "no") else positive(text)


def add_fabric_options(add: Add) -> None:
    """The command ``fabric``."""
    yarn, results = ("--material", "--radius"), ("--overwrite", "--resume", "--json")
    about = "Simulate a finite fabric, yarn by yarn or in a bounding volume."
    command = add("fabric", "fabric", about, *yarn, *results)
    option, stepping = command.add_argument, command.add_mutually_exclusive_group().add_argument
    stepping("--explicit", action="store_true", help="explicit steps, as long as they are stable")
    stepping(
        "--integrator", choices=("euler", "bdf2"), default="euler",
        help="of implicit steps: euler, of first order, damps much; bdf2, of second order with --damping 0 and "
        "--friction 0, damps little (euler)",
    )  # fmt: skip
    mu = {"type": not_negative, "metavar": "MU"}
    kinds = "a built-in pattern or a pattern file; splines: jersey and knits of knit and purl stitches on one bed"
    option("pattern", metavar="PATTERN", help=kinds)
    rows = "courses of jersey; periods of other patterns along their wales"
    option("--rows", type=_count, metavar="N", help=rows)
    columns = "wales of jersey; periods of other patterns along their courses"
    option("--columns", type=_count, metavar="M", help=columns)
    option(
        "--method", choices=("direct", "splines", "volume", "compare"), default="volume",
        help="direct: every yarn an elastic rod in contact with others; splines: every yarn a spline, held in its "
        "stitches by constraints; volume: yarns in a bounding volume, see --model; compare: splines, and "
        "both --reduction of them in a volume, side by side in the scenes hang and imposed (volume)",
    )  # fmt: skip
    model = "of the yarns in a volume: elastic rods or splines (splines for hanging jersey, else rods)"
    option("--model", choices=("rods", "splines"), help=model)
    volume = "control points of the volume (5,5,2)"
    option("--volume", type=_volume, default=(5, 5), metavar="N1,N2,2", help=volume)
    option(
        "--reduction", choices=("homogenized", "published"),
        help="elasticity of a volume of splines: homogenized, that of periodic cells of its stitches on the volume's "
        "mid-surface, with held and cast-on rows as full yarns; published, that of yarns fixed in the volume (LOD03), "
        "which hardly moves. Default: homogenized, with --explicit and --adaptive published; rods always are published",
    )  # fmt: skip
    adaptive = "insert knots of a published volume where the motion needs them"
    option("--adaptive", action="store_true", help=adaptive)
    option(
        "--scene", default="hang", metavar="hang|stretch|drape|imposed|FILE.toml",
        help="hang: held along the last row; stretch between two grips; drape over a ball; imposed, for compare: "
        "flexion, traction, shear and torsion along both axes (LOD03); or a scene file with"
        " handles and obstacles that may move (yarnscale help scene) (hang)",
    )  # fmt: skip
    mesh = "direct only: lay the pattern on a mesh with texture coordinates instead of --rows and --columns"
    option("--on", type=Path, metavar="MESH.obj", help=mesh)
    option("--unit", choices=("m", "cm", "mm", "inch"), help="of the lengths in MESH.obj (m)")
    weld = "sew coincident borders of MESH.obj, leave them loose, or sew borders within a distance"
    option("--weld", type=_weld, metavar="yes|no|METRES", help=weld)
    option("--tube", action="store_true", help="direct only: close the courses to rings")
    option(
        "--border", choices=("glued", "knitted"), default="glued",
        help="direct only: glued, cut from endless fabric and glued along its borders; knitted, yarn that is cast "
        "on, turns at the selvedges and is bound off, for built-in knits and charts (glued)",
    )  # fmt: skip
    drawn = "of rods: a built-in pattern or chart as it is drawn, not as fabric at rest; knitted pieces always are"
    option("--as-drawn", action="store_true", help=drawn)
    option("--amount", type=number, default=0.2, metavar="SHARE", help="of the scene stretch (0.2)")
    direction = "of the scene stretch (course)"
    option("--direction", choices=("course", "wale"), default="course", help=direction)
    friction = "of yarns on each other, not of splines (the yarn's, else 0.1); without any, loose weaves come apart"
    option("--friction", help=friction, **mu)
    option("--ball-friction", default=0.0, help="of yarns on the ball of drape (0)", **mu)
    option("--duration", type=positive, default=3.0, metavar="SECONDS", help="to simulate (3)")
    option("--time-step", type=positive, default=1 / 240, metavar="SECONDS", help="of implicit steps (1/240)")
    option("--damping", type=not_negative, default=1.0, metavar="RATE", help="of free motion [1/s] (1)")
    allowed = "grips that miss their prescribed places do not count as a failure"
    option("--may-give-way", action="store_true", help=allowed)
    option("--count", action="store_true", help="print the numbers of unknowns and simulate nothing")
    option("--out", type=Path, metavar="DIR", help="folder for frames, pictures and a page")
    option(
        "--format", action="append", choices=("obj", "gltf", "usd", "bcc", "mp4", "png"), default=[],
        help="convert the frames at the end; may be given several times",
    )  # fmt: skip

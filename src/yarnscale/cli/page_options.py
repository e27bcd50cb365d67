"""What the commands with a page in the browser take, ``register`` and ``view``; imports nothing heavy."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from yarnscale.cli.shared_options import Add
from yarnscale.cli.values import port, positive, two_lengths
from yarnscale.errors import quoted

_UNITS = {"px/mm": 1e-3, "px/cm": 1e-2, "dpi": 25.4e-3}
_SIZES = {"um/px": 1e-6, "µm/px": 1e-6, "μm/px": 1e-6, "mm/px": 1e-3}
_NUMBER = r"(\d+(?:\.\d*)?|\.\d+)"


def add_register_options(add: Add) -> None:
    """The command ``register``."""
    about = "Register the yarns of a fabric to photographs of its sides, with the order over and under from its chart."
    option = add("register", "register", about, "--json").add_argument
    option("--front", type=Path, metavar="FRONT.png", help="photograph of the right side, its wales upright")
    option("--back", type=Path, metavar="BACK.png", help="of the other side, the fabric turned over about a wale")
    option(
        "--traced", type=Path, metavar="FILE.svg",
        help="instead of photographs: curves traced over both sides, .svg (layers front and back, a rectangle period) "
        "or .csv (side,curve,x,y in mm)",
    )  # fmt: skip
    about = "chart, draft or built-in pattern: which yarns cross, and which is on top"
    option("--chart", required=True, metavar="KNIT.chart", help=about)
    option(
        "--scale", type=pixel_size, metavar="SCALE",
        help="of photographs or of an SVG's units: 40px/mm, 600dpi, 1.8um/px, or a length in the picture, 820px=20mm",
    )  # fmt: skip
    about = "of the chart [mm]: nearly, where pictures mislead; exactly, of traced curves"
    option("--period", type=two_lengths, metavar="WxH", help=about)
    about = "of the yarn (default: from the width of bright ridges; traced curves need it)"
    option("--radius", type=positive, metavar="METRES", help=about)
    option("--no-page", action="store_true", help="no page in the browser: the automatic registration alone")
    option("--port", type=port, default=0, metavar="N", help="of the page (a free one)")
    about = "begin anew instead of going on with the state beside the pattern"
    option("--overwrite", action="store_true", help=about)
    option("--out", type=Path, required=True, metavar="PATTERN.json", help="the pattern, at rest as it lies")


def add_view_options(add: Add) -> None:
    """The command ``view``."""
    about = "Look at a pattern, cell, material, run or estimate on a page that turns, stretches and plays."
    option = add("view", "view", about, "--material", "--as-drawn", "--json").add_argument
    thing = (
        "a pattern (name or file), STATE.npz of relax, a folder of sample, homogenize, simulate, detail, fabric or "
        "estimate, or a shell material (a name of the library or .json)"
    )
    option("thing", metavar="THING", help=thing)
    option("--port", type=port, default=0, metavar="N", help="of the page (a free one)")
    option("--browser", action="store_true", help="open the page in this machine's browser")
    about = "write one page that needs no network, instead of serving it"
    option("--export", type=Path, metavar="PAGE.html", help=about)


def pixel_size(text: str) -> float:
    """Size of a pixel [m] from ``40px/mm``, ``600dpi``, ``1.8um/px`` or a length in the picture, ``820px=20mm``."""
    plain = text.replace(" ", "")
    if (match := re.fullmatch(rf"{_NUMBER}px={_NUMBER}(mm|cm)", plain)) and float(match[1]) and float(match[2]):
        return float(match[2]) * (1e-3 if match[3] == "mm" else 1e-2) / float(match[1])
    for unit, size in _UNITS.items():
        if (match := re.fullmatch(_NUMBER + unit, plain)) and float(match[1]):
            return size / float(match[1])
    for unit, size in _SIZES.items():
        if (match := re.fullmatch(_NUMBER + unit, plain)) and float(match[1]):
            return size * float(match[1])
    expected = "40px/mm, 600dpi, 1.8um/px or 820px=20mm"
    raise argparse.ArgumentTypeError(f"expected {expected}; found {quoted(text)}")

"""Options that several commands share."""

from __future__ import annotations

import argparse
from typing import Any, Protocol

from yarnscale.cli.values import numbers, positive, positive_integer


class Add(Protocol):
    """Adds a command: its name, the module of its function, what it does, options that it shares with others."""

    def __call__(self, name: str, module: str, about: str, *shared: str) -> argparse.ArgumentParser: ...


PATTERN = "name of a built-in pattern (see 'yarnscale patterns'), or a .pyp, .json, .chart, .wif or .k file"
PATTERNS = "names of built-in patterns and .chart, .wif or .k files (default: all built-in ones)"
SHELL = "shell material: a name of the library (see 'yarnscale patterns') or a file, ours or published HYLC JSON"
YARN_MATERIAL = (
    "yarn material: a preset or a TOML file (default: the one in the pattern file or, for 'detail', of the run; else "
    "one for the built-in pattern, for knits, for weaves, or for splines, which is printed); repeat it to give each "
    "of the pattern's materials, in their order"
)

GROUPS = {
    "inputs": ("front", "back", "traced", "chart", "scale", "period", "pattern", "samples", "sample"),
    "yarn": ("material", "radius", "as-drawn", "free-sliding", "yarn-length", "stiffness", "friction"),
    "fabric at rest": ("wales", "courses", "loop-length", "tex", "area-density", "swatch"),
    "model": ("form", "method", "model", "volume", "reduction", "adaptive", "size", "sizes", "relaxed", "count"),
    "loads and states": ("strain", "solves", "limit", "visited", "grid", "directions", "loads", "curvatures"),
    "tests": ("against", "free-curvature", "cycles", "drape"),
    "form hylc2020": ("stretch", "shear", "curvature", "one-dimensional", "smoothing", "even-knots"),
    "search": (
        "solver", "seed", "starts", "refined", "iterations", "bending-weight", "follow", "shell-model", "holdout",
        "shape",
    ),
    "piece": ("rows", "columns", "on", "unit", "weld", "tube", "border"),
    "scene": ("scene", "shell", "amount", "travel", "direction", "air-drag", "ball-friction", "spacing"),
    "time steps": ("explicit", "integrator", "duration", "time-step", "damping", "animation", "may-give-way"),
    "pictures": ("picture", "fps", "speed", "colour", "camera", "wires", "yarns-as", "yarns", "seams", "megabytes"),
    "page": ("port", "browser", "export", "no-page"),
    "results": (
        "out", "overwrite", "resume", "json", "format", "frames", "homogenize", "positions", "moduli", "units",
    ),
    "processes": ("workers", "dask"),
}  # fmt: skip
"""Headings of options in the help of commands."""

SHARED: dict[str, dict[str, Any]] = {
    "pattern": {"metavar": "PATTERN", "help": PATTERN},
    "patterns": {"nargs": "*", "metavar": "PATTERN", "help": PATTERNS},
    "material": {"metavar": "SHELL", "help": SHELL},
    "--material": {"action": "append", "metavar": "YARN", "help": YARN_MATERIAL},
    "--radius": {
        "type": positive, "metavar": "METRES",
        "help": "of the yarn of a built-in pattern, chart or draft, which is drawn in its proportion (the pattern's "
        "own)",
    },
    "--as-drawn": {
        "action": "store_true",
        "help": "take a built-in pattern or chart as it is drawn, instead of bringing it to rest first",
    },
    "--free-sliding": {"action": "store_true", "help": "let yarns slide along themselves as a whole"},
    "--strain": {
        "type": numbers(5, "sx,sa,sy,lx,ly"), "default": (0.0,) * 5, "metavar": "sx,sa,sy,lx,ly",
        "help": "stretch along x, shear, stretch along y [-], curvature along x, along y [1/m]",
    },
    "--starts": {
        "type": positive_integer, "default": 1, "metavar": "N",
        "help": "starts, all but one perturbed; the lowest energy counts (1)",
    },
    "--solves": {
        "type": positive_integer, "metavar": "N", "help": "equilibria to sample (750; form hylc2020: 400)",
    },
    "--limit": {"type": positive, "metavar": "N/M", "help": "largest load in N/m (50, less for soft yarn)"},
    "--workers": {"type": positive_integer, "metavar": "N", "help": "processes (default: one per core)"},
    "--dask": {"metavar": "ADDRESS", "help": "scheduler of a Dask cluster, host:port"},
    "--resume": {"action": "store_true", "help": "continue an interrupted run"},
    "--overwrite": {
        "action": "store_true", "help": "replace what an earlier run of this command left there; other files stay",
    },
    "--json": {"action": "store_true", "help": "print one JSON object"},
}  # fmt: skip
"""Settings of ``add_argument`` by name."""

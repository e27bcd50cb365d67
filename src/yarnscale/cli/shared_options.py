"""Options that several commands share."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Protocol

from yarnscale.cli.values import numbers, positive, positive_integer

Option = Callable[..., argparse.Action]
"""Adds an option to a command, as ``ArgumentParser.add_argument``."""
Share = Callable[[argparse.ArgumentParser], object]
"""Adds options that several commands have."""


class Add(Protocol):
    """Adds a command: its name, the module of its function, what it does, options that it shares with others."""

    def __call__(self, name: str, module: str, about: str, *shared: Share) -> Option: ...


PATTERN = "name of a built-in pattern (see 'yarnscale patterns'), or a .pyp, .json, .chart, .wif or .k file"
PATTERNS = "names of built-in patterns and .chart, .wif or .k files (default: all built-in ones)"
SHELL = "shell material: a name of the library (see 'yarnscale patterns') or a file, ours or published HYLC JSON"
YARN_MATERIAL = (
    "yarn material: a preset or a TOML file (default: the one in the pattern file or, for 'detail', of the run; else "
    "one for the built-in pattern, for knits, for weaves, or for splines, which is printed); repeat it to give each "
    "of the pattern's materials, in their order"
)


GROUPS = {
    "yarn": ("material", "radius", "as-drawn", "free-sliding", "yarn-length", "stiffness", "friction"),
    "fabric at rest": ("wales", "courses", "loop-length", "tex", "area-density", "swatch"),
    "loads and states": ("strain", "solves", "limit", "visited", "grid", "directions", "loads", "curvatures"),
    "form hylc2020": ("stretch", "shear", "curvature", "one-dimensional", "smoothing", "even-knots"),
    "search": (
        "solver",
        "seed",
        "starts",
        "refined",
        "iterations",
        "bending-weight",
        "follow",
        "shell-model",
    ),
    "piece": ("rows", "columns", "on", "unit", "weld", "tube", "border"),
    "scene": (
        "scene",
        "shell",
        "amount",
        "travel",
        "direction",
        "air-drag",
        "ball-friction",
        "spacing",
    ),
    "time steps": ("duration", "time-step", "damping", "animation", "may-give-way"),
    "pictures": ("picture", "fps", "speed", "colour", "camera", "wires", "yarns-as", "megabytes"),
    "results": ("out", "overwrite", "resume", "json", "format"),
    "processes": ("workers", "dask"),
}
"""Headings of options in the help of commands."""


def add_json(command: argparse.ArgumentParser) -> None:
    """``--json``."""
    command.add_argument("--json", action="store_true", help="print one JSON object")


def add_radius(command: argparse.ArgumentParser) -> None:
    """``--radius``."""
    command.add_argument(
        "--radius", type=positive, metavar="METRES",
        help="of the yarn of a built-in pattern, chart or draft, which is drawn in its proportion (the pattern's own)",
    )  # fmt: skip


def add_material(command: argparse.ArgumentParser) -> None:
    """``--material`` of yarns."""
    command.add_argument("--material", action="append", metavar="YARN", help=YARN_MATERIAL)


def add_dask(command: argparse.ArgumentParser) -> None:
    """``--dask``."""
    command.add_argument("--dask", metavar="ADDRESS", help="scheduler of a Dask cluster, host:port")


def add_yarns(command: argparse.ArgumentParser) -> None:
    """A pattern and its yarn materials."""
    command.add_argument("pattern", metavar="PATTERN", help=PATTERN)
    add_material(command)
    add_radius(command)


def add_as_drawn(command: argparse.ArgumentParser) -> None:
    """``--as-drawn``."""
    command.add_argument(
        "--as-drawn", action="store_true",
        help="take a built-in pattern or chart as it is drawn, instead of bringing it to rest first",
    )  # fmt: skip


def add_cell_strain(command: argparse.ArgumentParser) -> None:
    """The macroscopic strain of one cell."""
    command.add_argument(
        "--strain", type=numbers(5, "sx,sa,sy,lx,ly"), default=(0.0,) * 5, metavar="sx,sa,sy,lx,ly",
        help="stretch along x, shear, stretch along y [-], curvature along x, along y [1/m]",
    )  # fmt: skip


def add_free_sliding(command: argparse.ArgumentParser) -> None:
    """``--free-sliding``."""
    command.add_argument("--free-sliding", action="store_true", help="let yarns slide along themselves as a whole")


def add_starts(default: int) -> Share:
    """``--starts`` of every solve."""
    return lambda command: command.add_argument(
        "--starts", type=positive_integer, default=default, metavar="N",
        help=f"starts, all but one perturbed; the lowest energy counts ({default})",
    )  # fmt: skip


def add_solves(command: argparse.ArgumentParser) -> None:
    """``--solves``."""
    solves = "equilibria to sample (600; form hylc2020: 400)"
    command.add_argument("--solves", type=positive_integer, metavar="N", help=solves)


def add_loads(command: argparse.ArgumentParser) -> None:
    """How many states, along loads up to which."""
    add_solves(command)
    command.add_argument("--limit", type=positive, metavar="N/M", help="largest load in N/m (50, less for soft yarn)")


def add_overwrite(command: argparse.ArgumentParser) -> None:
    """``--overwrite``."""
    command.add_argument(
        "--overwrite", action="store_true",
        help="replace what an earlier run of this command left there; other files stay",
    )  # fmt: skip


def add_processes(command: argparse.ArgumentParser) -> None:
    """``--workers``."""
    command.add_argument("--workers", type=positive_integer, metavar="N", help="processes (default: one per core)")


def add_workers(command: argparse.ArgumentParser) -> None:
    """``--workers`` and ``--resume``."""
    add_processes(command)
    add_resume(command)


def add_resume(command: argparse.ArgumentParser) -> None:
    """Going on after a kill."""
    command.add_argument("--resume", action="store_true", help="continue an interrupted run")

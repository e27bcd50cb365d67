"""Options of ``view``; imports nothing heavy."""

from __future__ import annotations

from pathlib import Path

from yarnscale.cli.shared_options import Add
from yarnscale.cli.values import port


def add_view_options(add: Add) -> None:
    """The command and its options."""
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

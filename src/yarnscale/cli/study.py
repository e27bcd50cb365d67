"""Command ``study``: what the size of the cell changes."""

from __future__ import annotations

import argparse

from yarnscale.cell import PeriodicCell
from yarnscale.cell.supercell import SizeResult, check_size
from yarnscale.cell.supercell import study as run_study
from yarnscale.cli.console import report
from yarnscale.cli.given_pattern import at_rest, pattern_of
from yarnscale.cli.yarn_choice import yarn_for
from yarnscale.kinematics import ShellStrain


def study(options: argparse.Namespace) -> int:
    """Relax cells of several sizes and compare."""
    pattern = pattern_of(options.pattern, options.radius)
    sx, sa, sy, lx, ly = options.strain
    yarn = yarn_for(options.pattern, pattern, options.material)
    for size in options.sizes:
        check_size(PeriodicCell(pattern, yarn.materials), size)
    yarn.print_status()
    pattern = at_rest(options, pattern, yarn.materials)
    cell = PeriodicCell(pattern, yarn.materials, options.free_sliding)
    results = run_study(cell, ShellStrain(sx, sa, sy, lx, 0.0, ly), options.sizes, starts=options.starts)
    lines = [
        f"{pattern.name} of {cell.material_name}, {options.starts} starts each",
        f"{'size':>6} {'vertices':>9} {'energy J/m²':>13} {'below 1x1':>10} {'iterations':>11} {'seconds':>8}",
    ]
    for result in results:
        lines.append(
            f"{_name(result):>6} {result.vertices:>9} {result.energy_density:>13.6g} {result.drop:>10.2%}"
            f" {result.iterations:>11} {result.seconds:>8.2f}"
            + ("" if result.state.usable else f"  {result.state.outcome}")
        )
    summary = {"pattern": pattern.name, **yarn.summary, "strain": list(options.strain)}
    summary |= {"starts": options.starts, "sizes": [_entry(result) for result in results]}
    report(options, summary, *lines)
    return 0 if all(result.state.usable for result in results) else 1


def _name(result: SizeResult) -> str:
    return f"{result.size[0]}x{result.size[1]}"


def _entry(result: SizeResult) -> dict[str, object]:
    numbers = ("vertices", "energy_density", "drop", "iterations", "seconds")
    found = {name: getattr(result, name) for name in numbers}
    return {"size": _name(result), **found, "status": result.state.outcome}

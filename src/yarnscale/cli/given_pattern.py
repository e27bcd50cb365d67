"""Patterns that commands are given: read, brought to rest, drawn."""

from __future__ import annotations

import argparse
from pathlib import Path

from yarnscale.cell import Equilibrium, PeriodicCell
from yarnscale.cell.rest import SETTING, RestRound, RestShape, set_as_drawn, settled
from yarnscale.cli.console import ProgressLine, print_status
from yarnscale.errors import InputError
from yarnscale.files.patterns import is_drawing, read_pattern
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.stiffness import Materials

LARGE = 1500
"""Vertices of a drawing beyond which commands that relax a cell leave its periods as drawn."""


def pattern_of(source: str, radius: float | None) -> YarnPattern:
    """A pattern by name or file; a drawing has yarn of ``radius`` [m] if given, other files then raise InputError."""
    pattern = read_pattern(source)
    if radius is None:
        return pattern
    if not is_drawing(source):
        raise InputError(
            "--radius", expected="a built-in pattern, a chart or a draft, which are drawings", found=source
        )
    return pattern.scaled(radius / pattern.radius)


def settled_drawing(drawn: YarnPattern, material: Materials) -> YarnPattern:
    """The fabric at rest of a drawing, with a line on the console, also where it is not quite at rest."""
    print_status(f"settling {drawn.name} to its rest shape")
    shape = watched_rest(drawn, material)
    if not shape.converged:
        print_status(f"{drawn.name} is not quite at rest: {shape.status.value}")
    return shape.pattern


def watched_rest(drawn: YarnPattern, material: Materials) -> RestShape:
    """``settled`` with progress on the console."""
    line, rounds, note = ProgressLine(f"settling {drawn.name}"), 0, ""

    def progress(reached: RestRound) -> None:
        nonlocal rounds, note
        rounds += 1
        stretch = " × ".join(f"{share:.3f}" for share in reached.stretch)
        note = f"round {rounds}, period {stretch} of the drawn one"

    def watch(iteration: int, residual: float) -> None:
        line.note(f"{note or 'first equilibrium'}, iteration {iteration}, residual {residual:.1e}")

    shape = settled(drawn, material, progress=progress, watch=watch)
    line.end()
    return shape


def at_rest(options: argparse.Namespace, drawn: YarnPattern, material: Materials) -> YarnPattern:
    """A pattern; a drawing is brought to rest unless ``--as-drawn``.

    Drawings of more than ``LARGE`` vertices keep their periods, and a line says so: to settle them takes minutes.
    """
    if options.as_drawn or not is_drawing(options.pattern):
        return drawn
    if len(drawn.edges) > LARGE:
        print_status(
            f"{drawn.name}: {len(drawn.edges)} vertices; yarns take on the shape of the drawing, as in fabric at rest, "
            "but periods stay as drawn, since these take minutes to settle; 'yarnscale pattern' does so"
        )
        return set_as_drawn(drawn, share=SETTING, lengths=False)
    return settled_drawing(drawn, material)


def draw_cell(path: Path, cell: PeriodicCell, state: Equilibrium | None) -> None:
    """Picture of a cell with its copies and midsurface; None: as drawn, not relaxed."""
    from yarnscale.show.curves import pattern_curves
    from yarnscale.show.tubes import yarn_picture

    place = cell.placement(state)
    # Of a small cell more copies, so that the fabric shows.
    rings = 1 if cell.pattern.period.min() > 12.0 * cell.pattern.radius else 2
    curves = pattern_curves(cell.pattern, place, rings=rings)
    surface = None if state is None or state.strain.is_flat else cell.midsurface_grid(state, rings=rings)
    yarn_picture(path, curves, cell.pattern.radius, surface=surface, camera="oblique")

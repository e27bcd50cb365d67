"""Commands about yarns: ``patterns``, ``pattern``, ``relax``."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from yarnscale.cell import Equilibrium, PeriodicCell
from yarnscale.cell.rest import SETTING, RestRound, RestShape, set_as_drawn, settled
from yarnscale.cli.console import ProgressLine, print_status, report, writable_file
from yarnscale.cli.yarn_choice import YarnChoice, yarn_for
from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.files import material_library
from yarnscale.files.equilibrium_file import write_equilibrium
from yarnscale.files.patterns import WRITERS, is_drawing, read_pattern, structure_of, write_pattern
from yarnscale.kinematics import COMPONENTS, ShellStrain
from yarnscale.yarn.material import PRESETS
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.stiffness import Materials

LARGE = 1500
"""Vertices of a drawing beyond which commands that relax a cell leave its periods as drawn."""


def patterns(options: argparse.Namespace) -> int:
    """List patterns, and materials of yarns and of shells."""
    known = {"patterns": list(library.names()), "materials": list(PRESETS), "shells": list(material_library.names())}
    report(options, known, *(f"{kind}: {', '.join(names)}" for kind, names in known.items()))
    return 0


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


def pattern(options: argparse.Namespace) -> int:
    """Write a pattern, a drawing as fabric at rest or as drawn, or what it is drawn from."""
    writable_file(options.out, *WRITERS)
    writable_file(options.picture, ".png")
    built = pattern_of(options.pattern, options.radius)
    yarn, good, note = yarn_for(options.pattern, built, options.material), True, "as it is"
    yarn.print_status()
    suffix, structure = options.out.suffix.lower(), structure_of(options.pattern)
    if suffix in (".chart", ".k"):
        # Stitches have no shape at rest, and a chart is settled when it is read.
        note = "as drawn"
    elif structure is not None and not options.as_drawn:
        shape = watched_rest(built, yarn.materials)
        built, good, note = shape.pattern, shape.converged, shape.status.value
    # What was reached is written in any case: it is the place to look for what went wrong.
    write_pattern(built, options.out, yarns=yarn.materials, structure=structure)
    if suffix != ".json":
        print_status(f"{options.out}: {suffix} files hold no yarn material, .json files do")
    if options.picture is not None:
        draw_cell(options.picture, PeriodicCell(built, yarn.materials), None)
    width, height = 1e3 * built.period
    summary = {
        "out": str(options.out), "pattern": built.name, "vertices": len(built.edges), "period": built.period,
        "radius": built.radius, "state": note, **yarn.summary,
    }  # fmt: skip
    size = f"{len(built.edges)} vertices, period {width:.4g} × {height:.4g} mm"
    report(options, summary, f"{options.out}: {built.name}, {size}, {note}")
    return 0 if good else 1


def relax(options: argparse.Namespace) -> int:
    """Relax a cell and report."""
    writable_file(options.out, ".npz")
    writable_file(options.picture, ".png")
    tile = pattern_of(options.pattern, options.radius)
    sx, sa, sy, lx, ly = options.strain
    strain = ShellStrain(sx, sa, sy, lx, 0.0, ly)
    yarn, line = yarn_for(options.pattern, tile, options.material), ProgressLine(f"relaxing {tile.name}")
    yarn.print_status()
    PeriodicCell(tile, yarn.materials).warm_up(strain)
    source = at_rest(options, tile, yarn.materials).repeated(*options.size)
    cell = PeriodicCell(source, yarn.materials, options.free_sliding)
    cell = cell.with_options(starts=options.starts, watch=line.note_solve)
    state = cell.relax(strain)
    line.end()
    if options.out is not None:
        write_equilibrium(options.out, cell, state)
    if options.picture is not None:
        draw_cell(options.picture, cell, state)
    report(options, _summary(state, cell, yarn), *_lines(state, cell))
    return 0 if state.usable else 1


def _summary(state: Equilibrium, cell: PeriodicCell, yarn: YarnChoice) -> dict[str, object]:
    names = (
        "energy_density", "stress", "iterations", "seconds", "contacts", "min_distance_over_diameter", "residual",
        "energy_parts",
    )  # fmt: skip
    numbers = {name: getattr(state, name) for name in names}
    return {"status": state.outcome, **numbers, "pattern": cell.pattern.name, **yarn.summary}


def _lines(state: Equilibrium, cell: PeriodicCell) -> Iterator[str]:
    """What the console says of an equilibrium."""
    ended = "passages: yarns passed through each other" if state.passages else state.status.value
    yield f"{cell.pattern.name} of {cell.material_name}: {ended}"
    yield f"  energy density   {state.energy_density:.6g} J/m²"
    for name, value in zip(COMPONENTS, state.stress, strict=True):
        yield f"  d/d{name:<5}         {value:.6g} {'N/m' if name.startswith('s') else 'N'}"
    yield f"  contacts         {state.contacts}, closest {state.min_distance_over_diameter:.3f} diameters"
    yield f"  {state.iterations} iterations, {state.seconds:.2f} s"


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

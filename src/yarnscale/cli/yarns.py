"""Commands about yarns: ``patterns``, ``pattern``, ``relax``."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from yarnscale.cell import Equilibrium, PeriodicCell
from yarnscale.cli.console import ProgressLine, print_status, report, writable_file
from yarnscale.cli.given_pattern import at_rest, draw_cell, pattern_of, watched_rest
from yarnscale.cli.yarn_choice import YarnChoice, yarn_for
from yarnscale.drawing import library
from yarnscale.files import material_library
from yarnscale.files.equilibrium_file import write_equilibrium
from yarnscale.files.patterns import WRITERS, structure_of, write_pattern
from yarnscale.kinematics import COMPONENTS, ShellStrain
from yarnscale.yarn.material import PRESETS


def patterns(options: argparse.Namespace) -> int:
    """List patterns, and materials of yarns and of shells."""
    known = {"patterns": list(library.names()), "materials": list(PRESETS), "shells": list(material_library.names())}
    report(options, known, *(f"{kind}: {', '.join(names)}" for kind, names in known.items()))
    return 0


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

"""Commands about yarns: ``patterns``, ``pattern``, ``relax``."""

from __future__ import annotations

import argparse
import io
from pathlib import Path

import numpy as np

from yarnscale.cell import Equilibrium, PeriodicCell
from yarnscale.cli.console import print_json, writable_file
from yarnscale.errors import InputError
from yarnscale.files.atomic import write_bytes
from yarnscale.files.material_toml import read_material
from yarnscale.files.patterns import read_pattern, write_pattern
from yarnscale.kinematics import COMPONENTS, ShellStrain
from yarnscale.yarn import library
from yarnscale.yarn.material import PRESETS, YarnMaterial
from yarnscale.yarn.pattern import YarnPattern

FALLBACK = "hylc2020-stockinette"


def patterns(options: argparse.Namespace) -> int:
    """List patterns and materials."""
    if options.json:
        print_json({"patterns": list(library.names()), "materials": list(PRESETS)})
        return 0
    print("patterns: " + ", ".join(library.names()))
    print("materials: " + ", ".join(PRESETS))
    return 0


def material_for(pattern: YarnPattern, name: str | None) -> YarnMaterial:
    """The material asked for, or the published one of the pattern's name."""
    if name is not None:
        return read_material(name)
    own = f"hylc2020-{pattern.name}"
    return PRESETS[own if own in PRESETS else FALLBACK]


def pattern(options: argparse.Namespace) -> int:
    """Write a built-in pattern."""
    writable_file(options.out, ".pyp", ".json")
    writable_file(options.picture, ".png")
    if options.name not in library.names():
        raise InputError("unknown pattern", expected=", ".join(library.names()), found=repr(options.name))
    built = library.build(options.name, **({} if options.radius is None else {"radius": options.radius}))
    write_pattern(built, options.out)
    if options.picture is not None:
        cell = PeriodicCell(built, material_for(built, options.material))
        draw_cell(options.picture, cell, None)
    print(f"{options.out}: {options.name}, {len(built.edges)} vertices, period {built.period} m")
    return 0


def relax(options: argparse.Namespace) -> int:
    """Relax a cell and report."""
    writable_file(options.out, ".npz")
    writable_file(options.picture, ".png")
    source = read_pattern(options.pattern)
    sx, sa, sy, lx, ly = options.strain
    strain = ShellStrain(sx, sa, sy, lx, 0.0, ly)
    cell = PeriodicCell(source, material_for(source, options.material), options.free_sliding)
    state = cell.relax(strain)
    if options.out is not None:
        content = io.BytesIO()
        np.savez(content, positions=state.positions, twist=state.twist, edges=source.edges)
        write_bytes(options.out, content.getvalue())
    if options.picture is not None:
        draw_cell(options.picture, cell, state)
    _report(state, cell, as_json=options.json)
    return 0 if state.converged else 1


def _report(state: Equilibrium, cell: PeriodicCell, *, as_json: bool) -> None:
    if as_json:
        print_json(
            {
                "status": state.status.name.lower(),
                "energy_density": state.energy_density,
                "stress": state.stress,
                "iterations": state.iterations,
                "seconds": state.seconds,
                "contacts": state.contacts,
                "min_distance_over_diameter": state.min_distance_over_diameter,
                "residual": state.residual,
                "energy_parts": state.energy_parts,
                "pattern": cell.pattern.name,
                "material": cell.material.name,
            }
        )
        return
    print(f"{cell.pattern.name} of {cell.material.name}: {state.status.value}")
    print(f"  energy density   {state.energy_density:.6g} J/m²")
    for name, value in zip(COMPONENTS, state.stress, strict=True):
        print(f"  d/d{name:<5}         {value:.6g} {'J/m²' if name.startswith('s') else 'J/m'}")
    print(f"  contacts         {state.contacts}, closest {state.min_distance_over_diameter:.3f} diameters")
    print(f"  {state.iterations} iterations, {state.seconds:.2f} s")


def draw_cell(path: Path, cell: PeriodicCell, state: Equilibrium | None) -> None:
    """Picture of a cell with its copies and midsurface; None: as drawn, not relaxed."""
    from yarnscale.show.curves import periodic_curves
    from yarnscale.show.tubes import yarn_picture

    place = cell.placement(state)
    curves = periodic_curves(cell.pattern.edges, place, rings=1)
    flat = state is None or state.strain.is_flat
    surface = None if flat else cell.midsurface_grid(state)
    yarn_picture(path, curves, cell.pattern.radius, surface=surface, camera="oblique")

"""A page of patterns: each drawn, relaxed at rest and stretched, with its numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from yarnscale.cell import Equilibrium, PeriodicCell
from yarnscale.cell.rest import settled
from yarnscale.kinematics import ShellStrain
from yarnscale.show.curves import periodic_curves
from yarnscale.show.report import Cell, Picture, Section, Table, write_report
from yarnscale.show.tubes import yarn_picture
from yarnscale.yarn import library
from yarnscale.yarn.clearance import closest_approach
from yarnscale.yarn.material import YarnMaterial
from yarnscale.yarn.pattern import YarnPattern

STATES: dict[str, ShellStrain] = {
    "at rest": ShellStrain(),
    "s_x = 0.2": ShellStrain(s_x=0.2),
    "s_y = 0.2": ShellStrain(s_y=0.2),
}
"""Caption -> state that the gallery shows."""
COLUMNS = ("state", "status", "iterations", "time [s]", "energy [J/m²]", "closest yarns [diameters]")
SIZE = (560, 420)


@dataclass(frozen=True, eq=False)
class Exhibit:
    """A pattern of the gallery with its equilibria, in the order of the states asked for."""

    pattern: YarnPattern
    material: YarnMaterial
    clearance: float
    states: Mapping[str, Equilibrium]


def write_gallery(
    folder: str | Path,
    *,
    names: Sequence[str] | None = None,
    states: Mapping[str, ShellStrain] = STATES,
    at_rest: bool = False,
    size: tuple[int, int] = SIZE,
) -> list[Exhibit]:
    """Build, relax and draw library patterns (all by default); ``index.html`` and pictures in ``folder``.

    Every state is relaxed from the one before it. at_rest: first give every pattern the rest shape and periods at
    which it is free of stress (`cell.rest.settled`); takes longer. Raises InputError for an unknown name or a
    folder that cannot be written, and PicturesUnavailable where the machine cannot draw.
    """
    folder = Path(folder)
    exhibits, sections = [], []
    for name in library.names() if names is None else names:
        structure = library.structure(name)
        pattern, material = structure.build(name=name), YarnMaterial.preset(structure.material)
        if at_rest:
            pattern = settled(pattern, material).pattern
        exhibit = relaxed(pattern, material, states=states)
        exhibits.append(exhibit)
        sections.append(_section(folder, name, structure, exhibit, size))
    facts = {
        "patterns": len(exhibits),
        "states": sum(len(exhibit.states) for exhibit in exhibits),
        "converged": sum(state.converged for exhibit in exhibits for state in exhibit.states.values()),
    }
    write_report(folder / "index.html", "Patterns at rest and stretched", sections, facts=facts)
    return exhibits


def relaxed(
    pattern: YarnPattern, material: YarnMaterial, *, states: Mapping[str, ShellStrain] = STATES
) -> Exhibit:
    """A pattern with its equilibria."""
    cell, found, last = PeriodicCell(pattern, material), {}, None
    for caption, strain in states.items():
        last = cell.relax(strain, start=last)
        found[caption] = last
    clearance = closest_approach(pattern).distance / (2.0 * pattern.radius)
    return Exhibit(pattern, material, clearance, found)


def _section(
    folder: Path, name: str, structure: library.Structure, exhibit: Exhibit, size: tuple[int, int]
) -> Section:
    """Numbers and pictures of one pattern: as drawn, then every state, seen from the right side."""
    pattern = exhibit.pattern
    cell = PeriodicCell(pattern, exhibit.material)
    shown: dict[str, Equilibrium | None] = {"as drawn": None, **exhibit.states}
    pictures = []
    for number, (caption, state) in enumerate(shown.items()):
        path = folder / f"{name}-{number}.png"
        curves = periodic_curves(pattern.edges, cell.placement(state), rings=1)
        yarn_picture(path, curves, pattern.radius, camera="top", size=size)
        pictures.append(Picture(path, caption))
    rows = [_row(caption, state) for caption, state in exhibit.states.items()]
    return Section(name, [structure.definition, _facts(structure, exhibit)], [Table(COLUMNS, rows)], pictures)


def _row(caption: str, state: Equilibrium) -> list[Cell]:
    """Cells of `COLUMNS`."""
    solved = [caption, state.status.value, state.iterations, state.seconds]
    return [*solved, state.energy_density, state.min_distance_over_diameter]


def _facts(structure: library.Structure, exhibit: Exhibit) -> str:
    """Chart or draft and size in a sentence; rows from the top one down, as charts are read."""
    pattern = exhibit.pattern
    if structure.draft is None:
        source = "Chart " + " / ".join(reversed(structure.chart))
    else:
        source = "Draft " + " / ".join(
            "".join("x" if over else "." for over in row) for row in structure.draft[::-1]
        )
    px, py = pattern.period * 1e3
    return (
        f"{source}; {len(pattern.edges)} vertices, period {px:.3g} × {py:.3g} mm, yarn radius "
        f"{pattern.radius * 1e3:g} mm, drawn with centre lines {exhibit.clearance:.2f} diameters apart at the "
        f"closest, material {exhibit.material.name}."
    )

"""A page of patterns: each drawn, at rest and stretched, with its numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from yarnscale.cell import Equilibrium, PeriodicCell
from yarnscale.cell.rest import RestShape, settled
from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.files.patterns import is_drawing, read_pattern, structure_of
from yarnscale.kinematics import ShellStrain
from yarnscale.show.curves import pattern_curves, rings_for
from yarnscale.show.report import Cell, Picture, Section, Table, write_report
from yarnscale.show.strained_pane import cell_pane, shown_states
from yarnscale.show.tubes import room_of, yarn_picture
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
SIZE = (480, 480)


@dataclass(frozen=True, eq=False)
class Exhibit:
    """A pattern of the gallery with its equilibria, in the order of the states asked for.

    clearance: closest approach of the drawn yarns' centre lines [diameters]. rest: how the pattern came to rest; None
    where it is shown as drawn.
    """

    pattern: YarnPattern
    material: YarnMaterial
    clearance: float
    states: Mapping[str, Equilibrium]
    rest: RestShape | None = None

    @property
    def good(self) -> bool:
        """Whether it is at rest, and all states are equilibria of the same fabric."""
        found = all(state.usable for state in self.states.values())
        return found and (self.rest is None or self.rest.converged)


def write_gallery(
    folder: str | Path,
    *,
    names: Sequence[str] | None = None,
    states: Mapping[str, ShellStrain] = STATES,
    at_rest: bool = False,
    size: tuple[int, int] = SIZE,
    progress: Callable[[int, int, str], None] | None = None,
    executor: Executor | None = None,
) -> list[Exhibit]:
    """Build, relax and draw patterns; ``index.html`` and pictures in ``folder``.

    names: of library patterns (all by default), and files of structures. progress: gets patterns done, all of them, and
    the name of the last. executor: relaxes patterns side by side.

    Every state is relaxed from the one before it. at_rest: first give every pattern the rest shape and periods at
    which it is free of stress (`cell.rest.settled`); takes longer. Raises InputError for an unknown name or a
    folder that cannot be written, and PicturesUnavailable where the machine cannot draw.
    """
    folder = Path(folder)
    names = checked_names(library.names() if names is None else names)
    exhibits, sections = [], []
    made = (map if executor is None else executor.map)(partial(_exhibit, states=states, at_rest=at_rest), names)
    for number, (name, exhibit) in enumerate(zip(names, made, strict=True), start=1):
        drawn, _, definition = _drawn(name)
        exhibits.append(exhibit)
        sections.append(_section(folder / Path(name).stem, drawn, definition, exhibit, size))
        if progress is not None:
            progress(number, len(names), name)
    facts = {
        "patterns": len(exhibits),
        "states": sum(len(exhibit.states) for exhibit in exhibits),
        "converged": sum(s.usable for exhibit in exhibits for s in exhibit.states.values()),
    }
    if at_rest:
        facts["at rest"] = sum(exhibit.rest is not None and exhibit.rest.converged for exhibit in exhibits)
    write_report(folder / "index.html", "Patterns at rest and stretched", sections, facts=facts)
    return exhibits


def checked_names(names: Sequence[str]) -> list[str]:
    """Names of library patterns and files of structures, each once; InputError as ``read_pattern`` and for others."""
    for name in names:
        drawn = is_drawing(name)
        if drawn and name not in library.names():
            read_pattern(name)  # refuses what cannot be drawn
        if not drawn:
            raise InputError(
                "pattern that is no drawing", expected="built-in patterns, charts, drafts and knitout", found=repr(name)
            )
    return list(dict.fromkeys(names))


def _drawn(source: str) -> tuple[YarnPattern, YarnMaterial, list[str]]:
    """A pattern, its yarn, and sentences on what it is; rows from the top one down, as charts are read."""
    drawn, structure = read_pattern(source), structure_of(source)
    assert structure is not None
    preset = structure.material
    if source not in library.names() and structure.woven:
        preset = "hylc2020-basket"
    if structure.draft is None:
        rows = "Chart " + " / ".join(reversed(structure.chart))
    else:
        rows = "Draft " + " / ".join("".join("x" if over else "." for over in row) for row in structure.draft[::-1])
    return drawn, YarnMaterial.preset(preset), [structure.definition, rows]


def _exhibit(name: str, *, states: Mapping[str, ShellStrain], at_rest: bool) -> Exhibit:
    drawn, material, _ = _drawn(name)
    rest = settled(drawn, material) if at_rest else None
    pattern = drawn if rest is None else rest.pattern
    cell, found, last = PeriodicCell(pattern, material), {}, None
    for caption, strain in states.items():
        last = cell.relax(strain, start=last)
        found[caption] = last
    clearance = closest_approach(pattern).distance / (2.0 * pattern.radius)
    return Exhibit(pattern, material, clearance, found, rest)


def _section(stem: Path, drawn: YarnPattern, definition: list[str], exhibit: Exhibit, size: tuple[int, int]) -> Section:
    """Numbers and pictures of one pattern: as drawn, then every state, seen from the right side."""
    shown: list[tuple[str, YarnPattern, Equilibrium | None]] = [("as drawn", drawn, None)]
    shown += [(caption, exhibit.pattern, state) for caption, state in exhibit.states.items()]
    rings, pieces, pictures = rings_for(drawn.period, drawn.radius), [], []
    for caption, pattern, state in shown:
        place = PeriodicCell(pattern, exhibit.material).placement(state)
        pieces.append((caption, pattern_curves(pattern, place, rings=rings)))
    room = room_of([piece for _, piece in pieces], drawn.radius)
    for number, (caption, piece) in enumerate(pieces):
        path = stem.with_name(f"{stem.name}-{number}.png")
        yarn_picture(path, piece, drawn.radius, camera="top", size=size, room=room)
        pictures.append(Picture(path, caption))
    if exhibit.states:
        cell = PeriodicCell(exhibit.pattern, exhibit.material)
        pictures[1] = replace(pictures[1], pane=cell_pane(cell, shown_states(exhibit.states), drawn.name))
    rows = [_row(caption, state) for caption, state in exhibit.states.items()]
    *sentences, source = definition
    return Section(drawn.name, [*sentences, *_facts(source, exhibit)], [Table(COLUMNS, rows)], pictures)


def _row(caption: str, state: Equilibrium) -> list[Cell]:
    """Cells of `COLUMNS`."""
    status = "passages: yarns passed through each other" if state.passages else state.status.value
    solved: list[Cell] = [caption, status, state.iterations, state.seconds]
    return [*solved, state.energy_density, state.min_distance_over_diameter]


def _facts(source: str, exhibit: Exhibit) -> list[str]:
    """Chart or draft, size, and how the pattern came to rest."""
    pattern = exhibit.pattern
    px, py = pattern.period * 1e3
    how = "drawn" if exhibit.rest is None else "lying"
    sentences = [
        f"{source}; {len(pattern.edges)} vertices, period {px:.3g} × {py:.3g} mm, yarn radius "
        f"{pattern.radius * 1e3:g} mm, {how} with centre lines {exhibit.clearance:.2f} diameters apart at the "
        f"closest, material {exhibit.material.name}."
    ]
    if exhibit.rest is not None:
        ratio = float(exhibit.rest.stress.ratios.max())
        sentences.append(
            f"Settled in {exhibit.rest.seconds:.1f} s: {exhibit.rest.status.value}; stress at rest "
            f"{100 * ratio:.2g} % of that at 5 % strain."
        )
    return sentences

"""The page of virtual tests: curves of one fabric, or of two on top of each other, and the engineers' numbers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from yarnscale.laboratory.drape import DISC, SPECIMEN
from yarnscale.laboratory.programme import Difference, FabricTests
from yarnscale.show import theme
from yarnscale.show.plots import written_figure
from yarnscale.show.report import Cell, Picture, Section, Table, scaled, write_report

_STYLES = ("-", "--")
_MARKS = ("o", "x")


def write_page(folder: Path, found: Sequence[FabricTests], compared: Difference | None = None) -> Path:
    """Write ``index.html`` and its pictures; the second fabric is drawn dashed. Returns the page's path."""
    draw_tension(folder / "tension.png", found)
    draw_others(folder / "bending.png", found)
    pictures = [
        Picture(folder / "tension.png", _legend(found, "Tension, free across, by direction of pull"), wide=True),
        Picture(folder / "bending.png", _legend(found, "Bending, twist and shear"), wide=True),
    ]
    if any(tests.cycles for tests in found):
        _loops(folder / "cycles.png", found)
        pictures.append(Picture(folder / "cycles.png", _legend(found, "Cycles with friction"), wide=True))
    sections = [Section("Curves", (), (), pictures), *(numbers_section(tests) for tests in found)]
    if any(tests.drape is not None for tests in found):
        _outlines(folder / "drape.png", found)
        caption = "Shadow of the draped specimen from above; dotted: disc and flat specimen."
        sections.append(Section("Drape (Cusick)", (), (), [Picture(folder / "drape.png", caption)]))
    facts: dict[str, Cell] = {}
    for tests in found:
        facts[f"{tests.subject}: without equilibrium"] = tests.failed
    if compared is not None:
        facts |= {
            "largest difference of stretch": compared.stretch,
            "largest difference of contraction": compared.contraction,
            "stretch within 0.01 + 3 % [%]": 100 * compared.stretch_within,
            "contraction within 0.02 + 3 % [%]": 100 * compared.contraction_within,
        }
    path, title = folder / "index.html", " against ".join(tests.subject for tests in found)
    write_report(path, f"Virtual tests: {title}", sections, facts=facts)
    return path


def _legend(found: Sequence[FabricTests], what: str) -> str:
    if len(found) == 1:
        return f"{what}."
    return f"{what}. Full lines and dots: {found[0].subject}; dashed lines and crosses: {found[1].subject}."


def draw_tension(path: Path, found: Sequence[FabricTests]) -> None:
    """Load and contraction over stretch, loads on a logarithmic scale."""
    with written_figure(path, 9.0, 3.8) as figure:
        loads, contractions = figure.subplots(1, 2)
        for number, tests in enumerate(found):
            for k, direction in enumerate(tests.directions):
                points = [p for p in tests.pulled(direction) if p.status == "converged"]
                style = _style(number, k, f"{direction:g}°")
                stretch = [p.stretch for p in points]
                loads.plot(stretch, [p.load for p in points], **style)
                contractions.plot(stretch, [p.contraction for p in points], **style)
        loads.set(xlabel="stretch [–]", ylabel="load per width [N/m]", yscale="log")
        contractions.set(xlabel="stretch [–]", ylabel="contraction across [–]")
        loads.legend()


def draw_others(path: Path, found: Sequence[FabricTests]) -> None:
    """Moments of bending and twist over curvature, shear force over angle."""
    with written_figure(path, 12.0, 3.6) as figure:
        bent, twisted, sheared = figure.subplots(1, 3)
        for number, tests in enumerate(found):
            for k, direction in enumerate(dict.fromkeys(p.direction for p in tests.bending)):
                points = tests.bent(direction)
                _curve(bent, number, k, f"{direction:g}°", [(p.curvature, 1e3 * p.moment) for p in points])
            _curve(twisted, number, 0, "", [(p.twist, 1e3 * p.moment) for p in tests.twist])
            for k, tension in enumerate(dict.fromkeys(p.tension for p in tests.shear)):
                points = [(p.angle, p.force) for p in tests.shear if p.tension == tension]
                _curve(sheared, number, k, f"tension {tension:.3g} N/m", points)
        bent.set(xlabel="curvature [1/m]", ylabel="moment per width [mN]")
        twisted.set(xlabel="twist II12 [1/m]", ylabel="moment dΨ/dII12 [mN]")
        sheared.set(xlabel="trellis angle [°]", ylabel="shear force per width [N/m]")
        bent.legend()
        sheared.legend()


def _loops(path: Path, found: Sequence[FabricTests]) -> None:
    """Forces on the ways from zero and back, of all cycles."""
    labels = {
        "tension": ("stretch [–]", "load per width [N/m]"),
        "shear": ("trellis angle [°]", "shear force per width [N/m]"),
        "bending": ("curvature [1/m]", "moment per width [N]"),
    }
    with written_figure(path, 12.0, 3.6) as figure:
        for axes, (name, (way, force)) in zip(figure.subplots(1, 3), labels.items(), strict=True):
            for number, tests in enumerate(found):
                cycles = [cycle for cycle in tests.cycles if cycle.test == name]
                directions = list(dict.fromkeys(cycle.direction for cycle in cycles))
                for cycle in cycles:
                    colour = directions.index(cycle.direction)
                    style = _style(number, colour, f"{cycle.direction:g}°" if cycle.number == 1 else "_")
                    for legs in [(cycle.loading, cycle.unloading)] if name == "tension" else cycle.sides:
                        axes.plot(*np.array([*legs[0], *legs[1]]).reshape(-1, 2).T, **style)
                        style["label"] = None
            axes.set(xlabel=way, ylabel=force)
            axes.legend()


def _curve(axes: Axes, number: int, colour: int, label: str, points: list[tuple[float, float]]) -> None:
    x, y = np.array(sorted(points)).reshape(-1, 2).T
    axes.plot(x, y, **_style(number, colour, label))


def _style(number: int, colour: int, label: str) -> dict[str, Any]:
    """Colour by direction, line by fabric; only the first fabric stands in the legend."""
    return {
        "color": theme.YARNS[colour % len(theme.YARNS)],
        "linestyle": _STYLES[number],
        "marker": _MARKS[number],
        "markersize": 3.5,
        "label": label if number == 0 else None,
    }


def _outlines(path: Path, found: Sequence[FabricTests]) -> None:
    with written_figure(path, 4.4, 4.4) as figure:
        axes = figure.subplots()
        angle = np.radians(np.arange(361))
        for radius in (DISC, SPECIMEN):
            axes.plot(100 * radius * np.cos(angle), 100 * radius * np.sin(angle), ":", color=theme.MUTED)
        for number, tests in enumerate(found):
            if tests.drape is not None:
                radius = 100 * np.append(tests.drape.outline, tests.drape.outline[0])
                style = {**_style(number, number, ""), "marker": ""}
                axes.plot(radius * np.cos(angle), radius * np.sin(angle), **style)
        axes.set(xlabel="along the course [cm]", ylabel="along the wale [cm]", aspect="equal")


def numbers_section(tests: FabricTests) -> Section:
    """Tensile, bending and shear numbers of a fabric, and how it rolls."""
    tensile: list[list[Cell]] = [
        [s.direction, s.largest_load, s.EMT, s.LT, s.WT, s.RT, s.E5, s.E20, s.E100] for s in tests.tensile
    ]
    tensile_names = ["direction [°]", "largest load [N/m]", "EMT [–]", "LT [–]", "WT [J/m²]", "RT [%]"]
    tensile_names += ["E5 [%]", "E20 [%]", "E100 [%]"]
    bend: list[list[Cell]] = [
        [s.direction, scaled(s.B, 1e6), scaled(s.hysteresis, 1e3), scaled(s.bending_length, 1e3)] for s in tests.bend
    ]
    rolls: list[list[Cell]] = [[r.direction, r.curvature, r.side, 1e3 * r.saved, r.status] for r in tests.rolls]
    shear = tests.sheared
    tables = [
        Table(tensile_names, tensile, "Tension. EMT, LT, WT, RT as in KES up to the largest load; E as in FAST."),
        Table(
            ["direction [°]", "B [µN·m]", "2HB [mN]", "bending length C [mm]"], bend,
            "Bending. B, 2HB: KES; C: ASTM D1388.",
        ),
        Table(
            ["G, KES [N/m per degree]", "2HG [N/m]", "2HG5 [N/m]", "G, FAST [N/m]"],
            [[shear.G, shear.hysteresis, shear.hysteresis_5, shear.fast_G]],
            "Shear.",
        ),
        Table(
            ["direction [°]", "natural curvature [1/m]", "side inside", "energy released [mJ/m²]", "status"], rolls,
            "Curl of a free piece.",
        ),
    ]  # fmt: skip
    if tests.drape is not None:
        drape: list[list[Cell]] = [[100 * tests.drape.coefficient, tests.drape.folds, tests.drape.status]]
        tables.append(Table(["drape coefficient [%]", "folds", "status"], drape, "Cusick drape, 30 cm on 18 cm."))
    text = ["Yarns without friction return all work: hysteresis and resilience (2HG, 2HB, RT) are not known."]
    if tests.cycles:
        yarns = "" if tests.friction is None else f"Friction of yarns {tests.friction:g}. "
        text = [f"{yarns}Hysteresis and resilience are those of the first cycle."]
    return Section(f"{tests.subject} ({tests.kind})", text, tables)

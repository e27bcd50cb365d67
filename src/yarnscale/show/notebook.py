"""Pictures and short tables of the main objects, for notebooks."""

from __future__ import annotations

import html
import tempfile
from collections.abc import Callable, Mapping
from functools import singledispatch
from pathlib import Path

import numpy as np

from yarnscale.cell.equilibrium import Equilibrium
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.files.animation import Animation, Moment, Surface
from yarnscale.files.body_surface import BodySurface
from yarnscale.files.curve_frames import CurveSet
from yarnscale.homogeneous.loads import LoadedState
from yarnscale.homogenize.rays import LIMIT
from yarnscale.kinematics import COMPONENTS
from yarnscale.motion.scene import SimulatedOutcome
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.scenes.scene import SceneResult
from yarnscale.show import theme
from yarnscale.show.canvas import PicturesUnavailable
from yarnscale.show.curves import pattern_curves, rings_for
from yarnscale.show.estimate import curves_plot
from yarnscale.show.plots import written_figure
from yarnscale.show.report import Cell, cell_text, picture_source
from yarnscale.show.run_page import frames_picture
from yarnscale.show.strained_pane import load_paths
from yarnscale.show.tubes import yarn_picture
from yarnscale.swatches.yarn_estimate import FabricEstimate
from yarnscale.yarn.material import YarnMaterial
from yarnscale.yarn.pattern import YarnPattern

Draw = Callable[[Path], object]
"""Writes a picture to a path."""
_ROWS = 14


def html_of(thing: object) -> str:
    """A picture, where the machine can draw, and a table."""
    draw, rows = shown(thing)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.png"
        try:
            draw(path)
            picture = f'<img src="{picture_source(path)}" style="max-width: 420px" alt="">'
        except PicturesUnavailable as error:
            picture = html.escape(str(error))
    known = [(name, cell_text(value)) for name, value in rows.items() if isinstance(value, str | int | float)]
    cells = ([html.escape(text) for text in row] for row in known[:_ROWS])
    lines = "".join(f"<tr><td>{name}</td><td>{value}</td></tr>" for name, value in cells)
    style = 'style="display: flex; gap: 1.5em; align-items: center; flex-wrap: wrap"'
    return f"<div {style}>{picture}<table>{lines}</table></div>"


@singledispatch
def shown(thing: object) -> tuple[Draw, Mapping[str, Cell]]:
    """What draws a thing, and names and values of its table."""
    raise TypeError(f"no picture of {type(thing).__name__}")


@shown.register
def _(pattern: YarnPattern) -> tuple[Draw, Mapping[str, Cell]]:
    x, y = 1e3 * pattern.period
    rows: dict[str, Cell] = {
        "pattern": pattern.name, "yarns": len(pattern.yarns), "vertices": len(pattern.edges),
        "period [mm]": f"{x:.4g} × {y:.4g}", "yarn radius [mm]": 1e3 * pattern.radius,
    }  # fmt: skip
    place = PeriodicCell(pattern, YarnMaterial.preset("wool")).placement(None)
    curves = pattern_curves(pattern, place, rings=rings_for(pattern.period, pattern.radius))
    return lambda path: yarn_picture(path, curves, pattern.radius, camera="top", size=(640, 480)), rows


@shown.register
def _(cell: PeriodicCell) -> tuple[Draw, Mapping[str, Cell]]:
    draw, rows = shown(cell.pattern)
    return draw, {**rows, "yarn": cell.material_name, "area density [g/m²]": 1e3 * cell.area_density}


@shown.register
def _(state: Equilibrium) -> tuple[Draw, Mapping[str, Cell]]:
    rows: dict[str, Cell] = {"state": state.outcome, "energy [J/m²]": state.energy_density}
    for k, name in enumerate(COMPONENTS):
        strain, stress = float(state.strain.vector[k]), cell_text(float(state.stress[k]))
        rows[f"{name}{' [1/m]' if k > 2 else ''}; stress [{'N/m' if k < 3 else 'N'}]"] = (
            f"{cell_text(strain)}; {stress}"
        )
    rows["closest yarns [diameters]"] = state.min_distance_over_diameter

    def draw(path: Path) -> None:
        with written_figure(path, 4.2, 3.2) as figure:
            axes = figure.subplots()
            x, y, z = 1e3 * state.positions.T
            dots = axes.scatter(x, y, c=z, s=14, cmap=theme.SEQUENTIAL)
            figure.colorbar(dots, label="height [mm]")
            axes.set(xlabel="x [mm]", ylabel="y [mm]", title="vertices of the yarns", aspect="equal")

    return draw, rows


@shown.register
def _(material: ShellMaterial) -> tuple[Draw, Mapping[str, Cell]]:
    stiffness = np.diag(material.moduli(np.zeros(6)))
    rows: dict[str, Cell] = {
        "shell material": type(material).__name__, "density [g/m²]": 1e3 * material.density,
        "stiffness at rest, courses [N/m]": float(stiffness[0]), "wales [N/m]": float(stiffness[2]),
        "shear [N/m]": float(stiffness[1]), "bending, courses [µN m]": 1e6 * float(stiffness[3]),
        "bending, wales [µN m]": 1e6 * float(stiffness[5]),
    }  # fmt: skip

    def draw(path: Path) -> None:
        paths = load_paths(material, 0.1 / float(material.strain_scale[3]), LIMIT, False)
        with written_figure(path, 5.6, 2.8) as figure:
            left, right = figure.subplots(1, 2)
            for place, name in ((0, "courses"), (2, "wales")):
                _line(left, paths.get(f"tension along {name}", []), place, 100.0, 1.0, name)
                bent = [
                    *reversed(paths.get(f"bending of {name}, outwards", [])),
                    *paths.get(f"bending of {name}, inwards", []),
                ]
                _line(right, bent, 3 + place, 1.0, 1e3, name)
            left.set(xlabel="stretch [%]", ylabel="tension [N/m]")
            right.set(xlabel="curvature [1/m]", ylabel="moment [mN]")
            left.legend()

    return draw, rows


def _line(axes, states: list[LoadedState], place: int, x: float, y: float, name: str) -> None:
    axes.plot([x * s.strain[place] for s in states], [y * s.stress[place] for s in states], marker=".", label=name)


@shown.register
def _(outcome: SimulatedOutcome) -> tuple[Draw, Mapping[str, Cell]]:
    state, scene = outcome.state, outcome.scene
    if isinstance(outcome, SceneResult):
        mesh, obstacles = scene.cloth.mesh, scene.cloth.obstacles
        surface, curves = Surface(mesh.triangles, mesh.material, mesh.corners), None
        moment = Moment(state.time, cloth=state.positions)
    else:
        lines, obstacles, surface = scene.lines, scene.obstacles, None
        curves = CurveSet(lines.offsets, lines.radii, closed=lines.closed, yarn=lines.colours)
        moment = Moment(state.time, yarns=scene.points(state), radii=curves.radii)
    bodies, seen = BodySurface(obstacles), None
    if bodies:
        seen = Surface(bodies.triangles)
        moment = Moment(moment.time, moment.cloth, None, moment.yarns, moment.radii, bodies.vertices(state.time))
    last = Animation(np.array([state.time]), lambda _: moment, surface, curves, seen)
    return lambda path: frames_picture(path, last, columns=1), outcome.summary()  # type: ignore[return-value]


@shown.register
def _(estimate: FabricEstimate) -> tuple[Draw, Mapping[str, Cell]]:
    percent = {
        "error, comfort range [%]": estimate.error.comfort, "full range [%]": estimate.error.full,
        "contraction [%]": estimate.error.compression,
    }  # fmt: skip
    errors = {name: None if value is None else 100 * value for name, value in percent.items()}
    return lambda path: curves_plot(path, estimate), {**errors, **estimate.parameters}

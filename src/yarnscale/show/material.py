"""Pictures of a homogenized material beside its samples: tension and pure bending along courses and wales."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import SymLogNorm

from yarnscale.arrays import Array
from yarnscale.homogeneous.fabrics import MaterialFabric
from yarnscale.homogeneous.loads import FLAT, LoadedState, Loads, Prescribed, equilibrium_under, path_under
from yarnscale.homogenize.states import FabricStates
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.materials.spline_material import SplineMaterial
from yarnscale.shell.materials.spline_patches import AXES, PLANES
from yarnscale.show import theme
from yarnscale.show.plots import written_figure

DIRECTIONS = (("course", 0.0, 0), ("wale", math.pi / 2, 2))
"""Name, angle from the course, and place of the stretch along in a strain vector; curvature stands three further."""
PICTURES = {
    "tension.png": "Tension along courses and wales, free across: cell (dots) and material (line).",
    "bending.png": "Moment of pure bending along courses and wales: cell (dots) and material (line).",
}
"""File name and what it shows."""
TERMS = "terms.png"
_NEXT_TO_NOTHING = 0.03


def draw_curves(material: ShellMaterial, samples: FabricStates, folder: Path) -> None:
    """Write ``PICTURES``; samples along loads."""
    _curves(folder / "tension.png", material, samples, _tension)
    _curves(folder / "bending.png", material, samples, _bending)


def draw_terms(material: SplineMaterial, samples: FabricStates, path: Path) -> None:
    """The terms of two in-plane strains of the published form, as HYLC20 Fig. 13 shows them; samples of strains."""
    columns = ("samples", "terms of one strain", "samples less these", "all terms", "error")
    pairs = [pair for pair in PLANES[:3] if pair in material.planes]
    acting = np.abs(samples.strains) > 1e-9 * np.abs(samples.strains).max(axis=0)
    with written_figure(path, 11.0, 2.4 * len(pairs)) as figure:
        for row, pair in zip(figure.subplots(len(pairs), 5, squeeze=False), pairs, strict=True):
            on_plane = ~np.delete(acting, pair, axis=1).any(axis=1)
            places, energies = samples.strains[on_plane][:, pair], samples.energies[on_plane] - material.constant
            u, v = (np.linspace(1.15 * material.range[k, 0], 1.15 * material.range[k, 1], 60) for k in pair)
            first, second = (material.axes[k] for k in pair)
            single = first(u)[:, None] + second(v)
            alone = first(places[:, 0]) + second(places[:, 1])
            term = material.planes[pair]
            together = single + term(u[:, None], v)
            most = max(float(np.abs(together).max()), 1e-9)
            norm = SymLogNorm(1e-3 * most, vmin=-most, vmax=most)
            error = alone + term(*places.T) - energies
            parts = (energies, single, energies - alone, together, error)
            for axes, name, values in zip(row, columns, parts, strict=True):
                if values.ndim == 2:
                    image = axes.pcolormesh(u, v, values.T, norm=norm, cmap="coolwarm", shading="gouraud")
                else:
                    image = axes.scatter(*places.T, c=values, s=9, norm=norm, cmap="coolwarm")
                axes.set(title=name, xlabel=AXES[pair[0]], ylabel=AXES[pair[1]], xlim=u[[0, -1]], ylim=v[[0, -1]])
            figure.colorbar(image, ax=row, label="J/m²")


def _curves(path: Path, material: ShellMaterial, samples: FabricStates, draw: Any) -> None:
    fabric = MaterialFabric(material)
    with written_figure(path, 7.2, 3.2) as figure:
        for axes, (name, angle, place) in zip(figure.subplots(1, 2), DIRECTIONS, strict=True):
            axes.set_title(f"along the {name}", fontsize=9)
            draw(axes, samples, fabric, angle, place)


def _line_and_dots(axes: Axes, line: tuple[Array, Array], dots: tuple[Array, Array]) -> None:
    axes.plot(*line, color=theme.FIT, zorder=2, label="material")
    axes.plot(*dots, "o", color=theme.SAMPLE, markersize=3.5, zorder=3, label="cell")
    axes.legend(fontsize=8)


def _tension(axes: Axes, states: FabricStates, fabric: MaterialFabric, angle: float, place: int) -> None:
    along = states.stresses[:, place]
    across = np.abs(np.delete(states.stresses[:, :3], place, axis=1)).max(axis=1)
    pulled = (states.kinds == "tension") & (along > 0) & (across < _NEXT_TO_NOTHING * along)
    loads = np.geomspace(max(float(along[pulled].min(initial=0.01)), 1e-3), float(along[pulled].max(initial=1.0)), 40)
    path = path_under(fabric, [Loads.tension(angle, float(load)) for load in loads], prescribed=FLAT)
    good = [k for k, state in enumerate(path) if state.converged]
    line = np.array([path[k].strain[place] for k in good]), loads[good]
    _line_and_dots(axes, line, (states.strains[pulled, place], along[pulled]))
    axes.set(yscale="log", xlabel="stretch [–]", ylabel="load [N/m]")


def _bending(axes: Axes, states: FabricStates, fabric: MaterialFabric, angle: float, place: int) -> None:
    curvature, others = states.strains[:, 3 + place], np.delete(states.strains[:, 3:], place, axis=1)
    bent = (states.kinds == "bending") & (np.abs(others) < _NEXT_TO_NOTHING * np.abs(curvature)[:, None]).all(axis=1)
    line: list[tuple[float, float]] = []
    for side in (-1.0, 1.0):
        state: LoadedState | None = None
        for value in np.linspace(0.0, np.abs(curvature[bent]).max(initial=0.0), 20):
            found = equilibrium_under(
                fabric, Loads(), prescribed=Prescribed.bent(angle, side * float(value)), start=state
            )
            if found.converged:
                state = found
                line.append((side * float(value), float(found.stress[3 + place])))
    x, y = np.array(sorted(line)).reshape(-1, 2).T
    _line_and_dots(axes, (x, 1e3 * y), (curvature[bent], 1e3 * states.stresses[bent, 3 + place]))
    axes.set(xlabel="curvature [1/m]", ylabel="moment [mN]")

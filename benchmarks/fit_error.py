"""Error of fitted materials on states they have not seen, over the number of solves.

Run ``python benchmarks/fit_error.py [PATTERN] [--solves N,N,…] [--unseen N] [--seed N] [--adaptive] [--picture
FILE.png]`` (default: stockinette.pyp of the reference data folder, ``../shared`` or ``$YARNSCALE_SHARED``; else the
built-in one). Four fits, with ``--adaptive`` five:

- published scheme: monotone Hermite splines through energies on the axes and planes (HYLC20 §6);
- energies: smooth splines of pairs of strains fitted to energies only;
- energies and stresses: the same, fitted to both;
- full: terms of all three in-plane strains too, on states inside the range;
- full, adaptive: the same, on the first plan and states that were chosen where fits disagree.

Errors are fractions of the largest energy above rest, or of the largest stress of a component, among unseen states.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from yarnscale.cell import PeriodicCell
from yarnscale.cli.yarns import material_for
from yarnscale.files.patterns import read_pattern
from yarnscale.homogenize.fit import FitOptions, FitReport, fit_spline_material, validate
from yarnscale.homogenize.plan import (
    StrainRange,
    axes_and_planes,
    axes_planes_and_inside,
    random_states,
    scattered_axes,
)
from yarnscale.homogenize.refine import refine
from yarnscale.homogenize.sample import create_store, sample
from yarnscale.homogenize.states import SampledStates
from yarnscale.homogenize.store import SampleStore
from yarnscale.shell.materials.spline_material import SplineMaterial
from yarnscale.shell.materials.spline_patches import PLANES
from yarnscale.shell.materials.tables import BicubicSpline, CubicSpline

Array = NDArray[np.float64]


def default_pattern() -> str:
    """The published stockinette where it is, else the built-in one."""
    shared = Path(os.environ.get("YARNSCALE_SHARED") or Path(__file__).resolve().parents[2] / "shared")
    path = shared / "reference" / "stockinette.pyp"
    return str(path) if path.is_file() else "stockinette"


def solved(cell: PeriodicCell, states: Array, folder: Path, *, moduli: bool = False) -> SampledStates:
    """Energies, stresses and, if asked, moduli of states."""
    store = create_store(folder, cell, scattered_axes(states), scattered=True, moduli=moduli)
    sample(cell, store, workers=1)
    return SampledStates.of(store)


def monotone_slopes(knots: Array, values: Array, axis: int = 0) -> Array:
    """Slopes at knots of the monotone cubic interpolation along an axis."""
    return np.asarray(PchipInterpolator(knots, values, axis=axis).derivative()(knots))


def published(data: SampledStates, density: float) -> SplineMaterial:
    """Monotone Hermite splines through the energies alone; states must lie on the axes and on grids of the planes."""
    acting, good = data.strains != 0, data.converged
    rest = float(data.energies[~acting.any(axis=1)][0])
    axes: list[CubicSpline] = []
    for k in range(5):
        on = good & (acting.sum(axis=1) == acting[:, k])
        knots, first = np.unique(data.strains[on, k], return_index=True)
        values = data.energies[on][first] - rest
        axes.append(CubicSpline(knots, values, monotone_slopes(knots, values)))
    planes = {}
    for i, j in PLANES:
        on = good & acting[:, i] & acting[:, j] & (acting.sum(axis=1) == 2)
        u, v = (np.unique(np.append(data.strains[on, k], 0.0)) for k in (i, j))
        values = np.zeros((len(u), len(v)))
        x, y = data.strains[on, i], data.strains[on, j]
        values[np.searchsorted(u, x), np.searchsorted(v, y)] = (
            data.energies[on] - rest - axes[i](x) - axes[j](y)
        )
        slopes = monotone_slopes(u, values), monotone_slopes(v, values, axis=1)
        planes[i, j] = BicubicSpline(u, v, values, *slopes, monotone_slopes(v, slopes[0], axis=1))
    return SplineMaterial(rest, tuple(axes), planes, density=density)


def fitted(data: SampledStates, density: float, *, stresses: bool, full: bool = False) -> SplineMaterial:
    """A smooth fit."""
    return fit_spline_material(
        data.strains,
        data.energies,
        data.stresses if stresses else None,
        density=density,
        moduli=data.moduli if stresses and full else None,
        valid=data.converged,
        options=FitOptions(in_plane="full" if full else "pairwise"),
    )


def fits(
    pairs: SampledStates, inside: SampledStates, chosen: SampledStates | None, density: float
) -> dict[str, tuple[SampledStates, SplineMaterial]]:
    """States and material by the name of the scheme."""
    found = {
        "published scheme": (pairs, published(pairs, density)),
        "energies": (pairs, fitted(pairs, density, stresses=False)),
        "energies and stresses": (pairs, fitted(pairs, density, stresses=True)),
        "full": (inside, fitted(inside, density, stresses=True, full=True)),
    }
    if chosen is not None:
        found["full, adaptive"] = (chosen, fitted(chosen, density, stresses=True, full=True))
    return found


def draw(path: Path, counts: list[int], found: dict[str, list[FitReport]]) -> None:
    """Median and 95th percentile of both errors over the solves."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(1, 2, figsize=(10, 4.2), sharex=True, layout="constrained")
    for name, reports in found.items():
        curves = (
            ([r.energy_median for r in reports], [r.energy_95 for r in reports]),
            ([np.nanmax(r.stress_median) for r in reports], [np.nanmax(r.stress_95) for r in reports]),
        )
        for panel, (middle, high) in zip(panels, curves, strict=True):
            line = panel.plot(counts, 100 * np.array(middle), "o-", label=name)[0]
            panel.plot(counts, 100 * np.array(high), "o:", color=line.get_color())
    for panel, title in zip(panels, ("energy", "stress, worst component"), strict=True):
        panel.set(
            xscale="log", yscale="log", xlabel="solves", ylabel="error on unseen states [%]", title=title
        )
        panel.set_xticks(counts, [str(n) for n in counts], minor=False)
        panel.minorticks_off()
        panel.yaxis.set_major_formatter("{x:g}")
        panel.grid(alpha=0.3)
    handles, names = panels[0].get_legend_handles_labels()
    title = "solid: median, dotted: 95th percentile"
    figure.legend(handles, names, title=title, loc="outside lower center", ncols=len(names), frameon=False)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Solve, fit, compare."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    arguments.add_argument("pattern", nargs="?", default=default_pattern())
    arguments.add_argument("--solves", default="100,200,400")
    arguments.add_argument("--unseen", type=int, default=300)
    arguments.add_argument("--seed", type=int, default=1, help="of the unseen states")
    arguments.add_argument("--adaptive", action="store_true")
    arguments.add_argument("--picture", type=Path)
    options = arguments.parse_args()
    pattern = read_pattern(options.pattern)
    cell = PeriodicCell(pattern, material_for(pattern, None))
    box, counts = StrainRange().bounds(pattern.radius), [int(n) for n in options.solves.split(",")]
    found: dict[str, list[FitReport]] = {}
    print(f"{pattern.name}, {options.unseen} unseen states; errors [%], median / 95th percentile")
    with tempfile.TemporaryDirectory() as folder:
        unseen = solved(cell, random_states(box, options.unseen, seed=options.seed), Path(folder) / "unseen")
        for count in counts:
            pairs = solved(cell, axes_and_planes(box, count), Path(folder) / f"pairs{count}")
            inside = solved(
                cell, axes_planes_and_inside(box, count), Path(folder) / f"inside{count}", moduli=True
            )
            chosen = None
            if options.adaptive:
                path = Path(folder) / "adaptive"
                plan = scattered_axes(axes_planes_and_inside(box, counts[0]))
                store = (
                    SampleStore(path)
                    if path.exists()
                    else create_store(path, cell, plan, scattered=True, moduli=True)
                )
                chosen = SampledStates.of(refine(cell, store, budget=count, workers=1).store)
            for name, (states, material) in fits(pairs, inside, chosen, cell.area_density).items():
                report = validate(
                    material, unseen.strains, unseen.energies, unseen.stresses, valid=unseen.converged
                )
                found.setdefault(name, []).append(report)
                stress = zip(report.stress_median, report.stress_95, strict=True)
                print(
                    f"{len(states.strains):4d} solves  {name:22s}"
                    f"  energy {100 * report.energy_median:5.2f} /{100 * report.energy_95:6.2f}   stress "
                    + "  ".join(f"{100 * m:5.2f} /{100 * h:6.2f}" for m, h in stress)
                )
    if options.picture:
        draw(options.picture, counts, found)


if __name__ == "__main__":
    main()

"""Diagrams of a homogenized material: samples beside the fit."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.files.atomic import write_bytes
from yarnscale.kinematics import COMPONENTS
from yarnscale.show import theme

Array = NDArray[np.float64]
EnergyOf = Callable[[Array], Array]
"""Energy density [J/m²] (n,) of strains (n, 6)."""
StressOf = Callable[[Array], Array]
"""Stress (n, 6) of strains (n, 6)."""

LABELS: Mapping[str, str] = {
    "s_x": "$s_x$, stretch along course [–]",
    "s_a": "$s_a$, shear [–]",
    "s_y": "$s_y$, stretch along wale [–]",
    "II11": "$II_{11}$, bending along course [1/m]",
    "II12": "$II_{12}$, twisting [1/m]",
    "II22": "$II_{22}$, bending along wale [1/m]",
}
STRESS_LABELS: Mapping[str, str] = {
    name: rf"$\partial\Psi/\partial {LABELS[name].split(',')[0].strip('$')}$ "
    + ("[N/m]" if name.startswith("s") else "[N]")
    for name in COMPONENTS
}
ENERGY_LABEL = r"$\Psi$, energy density [J/m²]"


@dataclass(frozen=True)
class AxisSamples:
    """Sampled states along one strain component, the others held.

    component: name from ``COMPONENTS``. values: of that component, shape (n,).
    energy: energy density [J/m²], shape (n,). stress: derivative of it by the component, shape (n,), or None.
    converged: which of them are equilibria, shape (n,); None means all.
    base: the other components, shape (6,); None is the rest state.
    """

    component: str
    values: Array
    energy: Array
    stress: Array | None = None
    converged: NDArray[np.bool_] | None = None
    base: Array | None = None

    @property
    def index(self) -> int:
        """Position of the component in a strain vector."""
        if self.component not in COMPONENTS:
            raise InputError("strain component", expected=" or ".join(COMPONENTS), found=self.component)
        return COMPONENTS.index(self.component)

    def strains(self, values: Array) -> Array:
        """Strain vectors (n, 6) at ``values`` (n,) of the component."""
        states = np.tile(np.zeros(6) if self.base is None else self.base, (len(values), 1))
        states[:, self.index] = values
        return states


def axis_plots(
    path: str | Path,
    axes: Sequence[AxisSamples],
    energy: EnergyOf,
    stress: StressOf | None = None,
    *,
    title: str = "",
) -> None:
    """Energy, and stress where ``stress`` is given, along each strain axis: samples as points, fit as line.

    energy, stress: the fitted material's ``energy_density`` and ``stress``. Writes a PNG or SVG file.
    Raises InputError on an unknown component or a file that cannot be written.
    """
    rows = 1 if stress is None else 2
    with written_figure(path, 3.1 * len(axes), 2.6 * rows, title=title) as figure:
        grid = figure.subplots(rows, len(axes), squeeze=False)
        for k, axis in enumerate(axes):
            _axis_panel(grid[0, k], axis, axis.energy, energy)
            grid[0, k].set_ylabel(ENERGY_LABEL if k == 0 else "")
            if stress is not None:
                _axis_panel(grid[1, k], axis, axis.stress, lambda s, i=axis.index: stress(s)[:, i])
                grid[1, k].set_ylabel(STRESS_LABELS[axis.component])
            grid[-1, k].set_xlabel(LABELS[axis.component])
        grid[0, 0].legend(loc="best", fontsize=8)


def plane_plot(
    path: str | Path,
    components: tuple[str, str],
    samples: Array,
    values: Array,
    energy: EnergyOf,
    *,
    converged: NDArray[np.bool_] | None = None,
    base: Array | None = None,
    quantity: str = ENERGY_LABEL,
    scale: Literal["linear", "log"] = "linear",
    title: str = "",
) -> None:
    """A fitted function over two strain components as colour, samples as dots coloured by their own value.

    samples: the two components of each sampled state, shape (n, 2). values: sampled there, shape (n,).
    energy: what is drawn, of strains (n, 6); ``quantity`` names it. A dot that vanishes fits.
    """
    first, second = (AxisSamples(c, np.empty(0), np.empty(0)).index for c in components)
    u, v = (np.linspace(samples[:, k].min(), samples[:, k].max(), 121) for k in (0, 1))
    grid_u, grid_v = np.meshgrid(u, v)
    states = np.tile(np.zeros(6) if base is None else base, (grid_u.size, 1))
    states[:, first], states[:, second] = grid_u.ravel(), grid_v.ravel()
    fitted = np.asarray(energy(states)).reshape(grid_u.shape)
    good = np.ones(len(values), bool) if converged is None else converged
    norm = _norm(np.concatenate([fitted.ravel(), np.asarray(values)[good]]), scale)
    fitted = np.clip(fitted, norm.vmin, norm.vmax)  # a logarithmic scale has no place for values below zero
    with written_figure(path, 4.6, 3.8, title=title) as figure:
        axes = figure.subplots()
        axes.grid(False)
        image = axes.pcolormesh(
            grid_u, grid_v, fitted, cmap=theme.SEQUENTIAL, norm=norm, shading="gouraud", rasterized=True
        )
        axes.contour(grid_u, grid_v, fitted, levels=12, colors="white", linewidths=0.4, alpha=0.6, norm=norm)
        dots: dict[str, Any] = {"cmap": theme.SEQUENTIAL, "norm": norm, "edgecolors": "white", "zorder": 3}
        axes.scatter(*samples[good].T, c=np.asarray(values)[good], s=26, linewidths=0.7, **dots)
        axes.scatter(*samples[~good].T, marker="x", color=theme.WARN, s=22, zorder=4)
        figure.colorbar(image, ax=axes, label=quantity)
        axes.set_xlabel(LABELS[components[0]])
        axes.set_ylabel(LABELS[components[1]])


def error_histogram(
    path: str | Path,
    errors: Mapping[str, Array],
    *,
    label: str = "relative error of the fit [%]",
    title: str = "",
) -> None:
    """Distribution of fit errors, one row per group (a strain axis or plane); errors: relative, (n,) each."""
    groups = {name: 100 * np.abs(np.asarray(e)[np.isfinite(e)]) for name, e in errors.items()}
    groups = {name: e for name, e in groups.items() if e.size}
    if not groups:
        raise InputError("fit errors", expected="at least one finite error", found="none")
    floor = 1e-4
    top = max(max(float(e.max()) for e in groups.values()), 10 * floor)
    bins = np.geomspace(floor, top * 1.001, 40)
    with written_figure(path, 5.2, 0.9 + 0.75 * len(groups), title=title) as figure:
        rows = figure.subplots(len(groups), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (name, values) in zip(rows, groups.items(), strict=True):
            axes.hist(np.clip(values, floor, None), bins=list(bins), color=theme.SAMPLE, alpha=0.85)
            middle = float(np.median(values))
            axes.axvline(max(middle, floor), color=theme.FIT, linewidth=1.4)
            axes.text(0.01, 0.78, f"{name}   median {middle:.2g} %", transform=axes.transAxes, fontsize=8)
            axes.set_xscale("log")
            axes.set_yticks([])
            axes.grid(False)
            axes.spines["left"].set_visible(False)
        rows[-1].set_xlabel(label)


def line_plot(
    path: str | Path,
    lines: Mapping[str, tuple[Array, Array]],
    *,
    x_label: str,
    y_label: str,
    title: str = "",
) -> None:
    """Curves by name, each (x, y) of shape (n,); labels with units."""
    with written_figure(path, 4.8, 3.2, title=title) as figure:
        axes = figure.subplots()
        for k, (name, (x, y)) in enumerate(lines.items()):
            axes.plot(x, y, color=theme.YARNS[k % len(theme.YARNS)], marker="o", markersize=3, label=name)
        axes.set_xlabel(x_label)
        axes.set_ylabel(y_label)
        if len(lines) > 1:
            axes.legend()


def _axis_panel(axes: Axes, axis: AxisSamples, samples: Array | None, fitted: EnergyOf) -> None:
    line = np.linspace(axis.values.min(), axis.values.max(), 241)
    axes.plot(line, fitted(axis.strains(line)), color=theme.FIT, label="fit", zorder=2)
    if samples is None:
        return
    good = np.ones(len(axis.values), bool) if axis.converged is None else axis.converged
    dots: dict[str, Any] = {"color": theme.SAMPLE, "markersize": 4, "label": "sample", "zorder": 3}
    axes.plot(axis.values[good], samples[good], "o", **dots)
    if not good.all():
        axes.plot(
            axis.values[~good], samples[~good], "x", color=theme.WARN, markersize=5, label="not converged"
        )


def _norm(values: Array, scale: str) -> Any:
    finite = values[np.isfinite(values)]
    positive = finite[finite > 0]
    if scale == "log" and positive.size:
        return LogNorm(positive.min(), positive.max(), clip=True)
    return Normalize(*(finite.min(), finite.max()) if finite.size else (0.0, 1.0))


@contextmanager
def written_figure(path: str | Path, width: float, height: float, *, title: str) -> Iterator[Figure]:
    """A figure [inches] in the common style, written to ``path`` at the end; never touches pyplot's state."""
    with matplotlib.rc_context(rc=dict(theme.PLOT_STYLE)):  # type: ignore[arg-type]
        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(figure)
        if title:
            figure.suptitle(title, color=theme.INK, fontsize=11)
        yield figure
        content = io.BytesIO()
        kind = "svg" if Path(path).suffix.lower() == ".svg" else "png"
        figure.savefig(content, format=kind, metadata={"Date": None} if kind == "svg" else None)
        write_bytes(path, content.getvalue())

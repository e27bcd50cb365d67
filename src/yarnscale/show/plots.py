"""Diagrams of a homogenized material: errors of the fit at samples and at unseen states."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.files.atomic import write_bytes
from yarnscale.show import theme


def stress_scatter(path: str | Path, groups: Mapping[str, tuple[Array, Array]], *, floor: float) -> None:
    """Norm of the fit's error over the norm of the stress, by group (norms (n,), errors (n,)) [N/m].

    floor: stress below which errors stop being relative. Lines show 1 % and 6 % of the norm plus the floor.
    """
    with written_figure(path, 5.2, 3.6) as figure:
        axes = figure.subplots()
        colors = (theme.FIT, theme.SAMPLE)
        for color, (name, (norms, errors)) in zip(colors, groups.items(), strict=False):
            axes.plot(np.maximum(norms, 1e-5), np.maximum(errors, 1e-7), ".", color=color, markersize=3, label=name)
        line = np.geomspace(1e-4, max(1.0, *(float(n.max(initial=0)) for n, _ in groups.values())), 100)
        for share in (0.01, 0.06):
            axes.plot(line, share * (line + floor), color=theme.INK, linewidth=0.8)
        axes.set(xscale="log", yscale="log", xlabel="stress of the cell [N/m]", ylabel="error of the fit [N/m]")
        axes.legend()


def error_histogram(
    path: str | Path, errors: Mapping[str, Array], *, label: str = "relative error of the fit [%]"
) -> None:
    """Distribution of fit errors, one row per group (a strain axis or plane); errors: relative, (n,) each."""
    groups = {name: 100 * np.abs(np.asarray(e)[np.isfinite(e)]) for name, e in errors.items()}
    groups = {name: e for name, e in groups.items() if e.size}
    if not groups:
        raise InputError("fit errors", expected="at least one finite error", found="none")
    floor = 1e-4
    top = max(max(float(e.max()) for e in groups.values()), 10 * floor)
    bins = np.geomspace(floor, top * 1.001, 40)
    with written_figure(path, 5.2, 0.9 + 0.75 * len(groups)) as figure:
        rows = figure.subplots(len(groups), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (name, values) in zip(rows, groups.items(), strict=True):
            axes.hist(np.clip(values, floor, None), bins=list(bins), color=theme.SAMPLE, alpha=0.85)
            middle = float(np.median(values))
            axes.axvline(max(middle, floor), color=theme.FIT, linewidth=1.4)
            axes.text(0.01, 0.78, f"{name}   median {middle:.2g} %", transform=axes.transAxes, fontsize=8)
            axes.set(xscale="log", yticks=[])
            axes.grid(False)
            axes.spines["left"].set_visible(False)
        rows[-1].set_xlabel(label)


@contextmanager
def written_figure(path: str | Path, width: float, height: float) -> Iterator[Figure]:
    """A figure [inches] in the common style, written to ``path`` at the end; never touches pyplot's state."""
    with matplotlib.rc_context(rc=dict(theme.PLOT_STYLE)):  # type: ignore[arg-type]
        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(figure)
        yield figure
        content = io.BytesIO()
        figure.savefig(content, format="png")
        write_bytes(path, content.getvalue())

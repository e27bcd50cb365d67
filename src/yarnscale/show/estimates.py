"""The page of a folder of fabrics: errors and parameters of their estimated yarns (EST22 Fig. 13 to 15)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from yarnscale.arrays import Array
from yarnscale.show import theme
from yarnscale.show.plots import written_figure
from yarnscale.show.report import Cell, Picture, Section, Table, write_report
from yarnscale.swatches.uniform_data import ERRORS

_UNITS = {"k_s1": "N", "k_s2": "N", "k_b": "N m²", "R_1": "m", "R_est": "m", "k_c1": "kg/s²"}


def write_estimates_page(path: Path, summaries: Mapping[str, Mapping[str, Any]]) -> None:
    """Write the page and its picture; summaries: ``FabricEstimate.summary()`` of every fabric by its name."""
    picture = path.with_name("fabrics.png")
    yarns = _column(summaries, "error")
    shells = _column({name: found["stages"] for name, found in summaries.items()}, "shell")
    cloths = _column({n: {"error": found["cloth_error"] or {}} for n, found in summaries.items()}, "error")
    _bars(picture, list(summaries), {"shell": shells, "yarn": yarns, "cloth": cloths})
    rows: list[list[Cell]] = []
    for k, (name, found) in enumerate(summaries.items()):
        errors = [*yarns[k], shells[k, 0], cloths[k, 0]]
        rows.append([name, *_percent(errors), found["failed_states"], found["solves"], round(found["cpu_seconds"])])
    if len(rows) > 1:
        mean = [*_means(yarns), _means(shells)[0], _means(cloths)[0]]
        rows.append(["mean", *_percent(mean), None, None, None])
    columns = ["fabric", *(f"{name} [%]" for name in ERRORS.values()), "shell, comfort [%]", "cloth, comfort [%]"]
    names = list(dict.fromkeys(name for found in summaries.values() for name in found["parameters"]))
    units = [f"{name} [{_UNITS[name]}]" if name in _UNITS else name for name in names]
    values = [[name, *(found["parameters"].get(n) for n in names)] for name, found in summaries.items()]
    built = list(next(iter(summaries.values()))["fabric"])
    fabrics = [[name, *(found["fabric"][n] for n in built)] for name, found in summaries.items()]
    sections = [
        Section(
            "Errors against the measurement",
            ["Mean errors over the largest measured value of the comfort range. Each folder has its own page."],
            [Table([*columns, "states not at rest", "equilibria", "processor seconds"], rows)],
            [Picture(picture, wide=True)],
        ),
        Section("Parameters of the yarns", (), [Table(["fabric", *units], values)]),
        Section("Fabrics at rest", (), [Table(["fabric", *built], fabrics)]),
    ]
    write_report(path, "Estimated yarns", sections, facts={"fabrics": len(summaries)})


def _column(summaries: Mapping[str, Mapping[str, Any]], part: str) -> Array:
    """Errors (n, 3) of a part of the summaries; NaN where there are none."""
    return np.array([[found[part].get(name) for name in ERRORS] for found in summaries.values()], np.float64).reshape(
        -1, len(ERRORS)
    )


def _means(errors: Array) -> list[float]:
    return [float(column[np.isfinite(column)].mean()) if np.isfinite(column).any() else np.nan for column in errors.T]


def _percent(shares: Sequence[float]) -> list[float | None]:
    return [100 * float(share) if np.isfinite(share) else None for share in shares]


def _bars(path: Path, names: Sequence[str], kinds: Mapping[str, Array]) -> None:
    """Errors of all fabrics, a panel for each kind of error, a bar for shell, yarn and cloth."""
    shown = {kind: errors for kind, errors in kinds.items() if np.isfinite(errors).any()}
    with written_figure(path, max(6.0, 2.0 + 0.35 * len(names) * len(shown)), 6.0) as figure:
        panels = figure.subplots(len(ERRORS), 1, sharex=True)
        for row, (axes, title) in enumerate(zip(panels, ERRORS.values(), strict=True)):
            for k, (kind, errors) in enumerate(shown.items()):
                place = np.arange(len(names)) + 0.8 * ((k + 0.5) / len(shown) - 0.5)
                heights = np.nan_to_num(100 * errors[:, row])
                axes.bar(place, heights, 0.8 / len(shown), label=kind, color=theme.YARNS[k])
            axes.set_ylabel(f"{title} [%]")
            axes.set_ylim(bottom=0)
        panels[-1].set_xticks(range(len(names)), names, rotation=45 if len(names) > 5 else 0)
        panels[0].legend(ncols=len(shown), frameon=False)

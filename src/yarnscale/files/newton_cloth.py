"""Virtual tests for other engines: one neutral table, and parameters of Newton's cloth with what they lose."""

from __future__ import annotations

import csv
import io
import math
import statistics
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from yarnscale.files.atomic import write_json, write_text
from yarnscale.laboratory.programme import FabricTests
from yarnscale.laboratory.style3d import Style3DFit
from yarnscale.laboratory.table import Deviation, Measured, measured

NEWTON = "1.8"
"""Version of Newton whose cloth was read and simulated."""


def write_tests_table(path: str | Path, tests: FabricTests) -> None:
    """Write every number of virtual tests as CSV, one a row, units in columns of their own."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("test", "direction [degrees]", "given", "at", "unit", "measured", "value", "value unit", "status"))
    writer.writerows(_row(row) for row in measured(tests))
    write_text(path, text.getvalue())


def _row(row: Measured) -> tuple[object, ...]:
    value = f"{row.value:.9g}" if math.isfinite(row.value) else ""
    direction = "" if row.direction is None else f"{row.direction:g}"
    return (
        row.test, direction, row.given, f"{row.at:.9g}", row.unit, row.quantity, value, row.value_unit, row.status,
    )  # fmt: skip


def write_newton_cloth(path: str | Path, fit: Style3DFit, subject: str) -> dict[str, object]:
    """Write parameters of Newton's cloth as JSON, with the certificate of their errors; what was written."""
    cloth = fit.cloth
    content: dict[str, object] = {
        "format": "yarnscale newton cloth",
        "newton": NEWTON,
        "material": subject,
        "density": cloth.density,
        "tri_aniso_ke": cloth.stretch,
        "edge_aniso_ke": cloth.bend,
        "units": {
            "density": "kg/m²", "tri_aniso_ke": "N/m (weft, warp, shear)", "edge_aniso_ke": "J (weft, warp, 45°)",
        },
        "use": "arguments of newton.solvers.style3d.add_cloth_mesh, the last two as wp.vec3(*numbers)",
        "loads": {"unit": "N/m", "range": fit.loads},
        "not_represented": fit.lost,
        "certificate": [_deviation(one) for one in fit.deviations],
    }  # fmt: skip
    write_json(path, content)
    return content


def _deviation(one: Deviation) -> dict[str, object]:
    row = one.reference
    return {
        "test": row.test, "direction": row.direction, "given": row.given, "at": row.at, "unit": row.unit,
        "measured": row.quantity, "value_unit": row.value_unit, "material": row.value,
        "newton": one.other if math.isfinite(one.other) else None,
        "error_percent": one.error if math.isfinite(one.error) else None,
    }  # fmt: skip


class ErrorSizes(NamedTuple):
    """Errors of a test along one direction: median and largest size [%], NaN where no number is known.

    failed: for how many of its ``count`` numbers the cloth found no equilibrium.
    """

    median: float
    largest: float
    failed: int
    count: int

    def __str__(self) -> str:
        known = f"{self.median:.3g} %, {self.largest:.3g} %" if self.failed < self.count else ""
        failed = f"{self.failed} of {self.count} without equilibrium" if self.failed else ""
        return ", ".join(filter(None, (known, failed)))


def errors_by_test(deviations: Iterable[Deviation]) -> dict[str, ErrorSizes]:
    """Errors of every test and direction."""
    found: dict[str, list[Deviation]] = {}
    for one in deviations:
        row = one.reference
        place = "" if row.direction is None else f" along {row.direction:g}°"
        # Numbers that are zero throughout a test have no relative error.
        if math.isfinite(one.error) or not math.isfinite(one.other):
            found.setdefault(f"{row.test}{place}, {row.quantity}", []).append(one)
    return {name: _sizes(ones) for name, ones in found.items()}


def _sizes(deviations: list[Deviation]) -> ErrorSizes:
    known = [abs(one.error) for one in deviations if math.isfinite(one.other)]
    median, largest = (statistics.median(known), max(known)) if known else (math.nan, math.nan)
    return ErrorSizes(median, largest, len(deviations) - len(known), len(deviations))

"""Virtual tests for other engines: one neutral table, and parameters of Newton's cloth with what they lose."""

from __future__ import annotations

import csv
import io
import math
import statistics
from collections.abc import Iterable
from pathlib import Path

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


def write_newton_cloth(path: str | Path, fit: Style3DFit, subject: str) -> None:
    """Write parameters of Newton's cloth as JSON, with the certificate of their errors."""
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


def _deviation(one: Deviation) -> dict[str, object]:
    row = one.reference
    return {
        "test": row.test, "direction": row.direction, "given": row.given, "at": row.at, "unit": row.unit,
        "measured": row.quantity, "value_unit": row.value_unit, "material": row.value,
        "newton": one.other if math.isfinite(one.other) else None,
        "error_percent": one.error if math.isfinite(one.error) else None,
    }  # fmt: skip


def errors_by_test(deviations: Iterable[Deviation]) -> dict[str, str]:
    """Median and largest size of the errors [%] of every test and direction, and how many have no equilibrium."""
    found: dict[str, list[Deviation]] = {}
    for one in deviations:
        row = one.reference
        place = "" if row.direction is None else f" along {row.direction:g}°"
        # Numbers that are zero throughout a test have no relative error.
        if math.isfinite(one.error) or not math.isfinite(one.other):
            found.setdefault(f"{row.test}{place}, {row.quantity}", []).append(one)
    return {name: _sizes(ones) for name, ones in found.items()}


def _sizes(deviations: list[Deviation]) -> str:
    known = [abs(one.error) for one in deviations if math.isfinite(one.other)]
    sizes = f"{statistics.median(known):.3g} %, {max(known):.3g} %" if known else ""
    lost = len(deviations) - len(known)
    return ", ".join(filter(None, (sizes, f"{lost} of {len(deviations)} without equilibrium" if lost else "")))

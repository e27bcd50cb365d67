"""Biaxial readings: fabric pulled along weft and warp at once, one state a row.

Columns ``force_weft_UNIT`` and ``force_warp_UNIT``, over the width (N/m) or with ``width_weft_UNIT`` and
``width_warp_UNIT`` of the arms, and ``strain_weft_UNIT`` and ``strain_warp_UNIT``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import located
from yarnscale.files.measurements_csv import tables_of
from yarnscale.files.measurements_swatches import constant
from yarnscale.files.measurements_table import MeasuredTable
from yarnscale.swatches.measurements import BiaxialTest

_ALONG = ("weft", "warp")


def read_biaxial(path: Path) -> BiaxialTest:
    """The states of all tables of a file, in their order. Raises InputError with row and column."""
    tables = tables_of(path, ("force_weft", "force_warp", "strain_weft", "strain_warp"))
    states = [np.hstack([_both(table, "strain"), _loads(table)]) for table in tables]
    stretch, load = np.hsplit(np.vstack(states), 2)
    with located(path):
        return BiaxialTest(stretch, load)


def _both(table: MeasuredTable, quantity: str) -> Array:
    """Numbers along weft and warp in SI, (n, 2)."""
    return np.column_stack([table.numbers(table.column(f"{quantity}_{a}"), table.rows) for a in _ALONG])


def _loads(table: MeasuredTable) -> Array:
    """Loads along weft and warp [N/m], (n, 2)."""
    loads = _both(table, "force")
    for k, along in enumerate(_ALONG):
        if table.column(f"force_{along}").kind == "force":
            loads[:, k] /= constant(table, table.column(f"width_{along}"), list(table.rows))
    return loads

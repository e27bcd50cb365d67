"""Arrays of numbers, as annotations name them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Numbers in double precision."""
Integers = NDArray[np.int64]
"""Whole numbers: indices and counts."""
Flags = NDArray[np.bool_]
"""Truth values."""

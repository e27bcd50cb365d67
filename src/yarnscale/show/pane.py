"""What a page draws in three dimensions: a pane's description and arrays as one text, and the scripts that show it."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from yarnscale.arrays import Array
from yarnscale.show import theme

_KINDS = {"f": "f4", "i": "i4", "u": "u1", "b": "u1"}
"""Kind of an array -> type in the page; integers have 32 bits, unsigned ones 8."""


@dataclass(frozen=True, eq=False)
class Pane:
    """A view that turns.

    title: of the view. header: its description (reference/viewer_format). arrays: numbers by name, kept in single
    precision, as 32-bit or as unsigned 8-bit integers.
    """

    title: str
    header: Mapping[str, object]
    arrays: Mapping[str, NDArray]

    def text(self) -> str:
        """JSON for a script element of a page."""
        parts, places, start = [], {}, 0
        for name, array in self.arrays.items():
            kind = _KINDS[array.dtype.kind]
            content = np.ascontiguousarray(array, f"<{kind}" if kind != "u1" else "u1").tobytes()
            places[name] = [kind, array.size, start]
            parts += [content, bytes(-len(content) % 4)]
            start += len(content) + len(parts[-1])
        looks = {"palette": theme.YARNS, "faint": theme.FAINT, "map": _colour_map(), "body_colour": theme.OBSTACLE}
        data = base64.b64encode(zlib.compress(b"".join(parts), 9)).decode("ascii")
        header = {"title": self.title, **looks, **self.header, "arrays": places, "data": data}
        # No name ends the script or begins a comment in it.
        return json.dumps(header, allow_nan=False).replace("<", "\\u003c")


def framed(points: Array) -> dict[str, object]:
    """Centre and half diagonal of the box of points (n, 3) [m]: origin and unit of the scene."""
    low, high = points.min(axis=0), points.max(axis=0)
    return {"centre3": (0.5 * (low + high)).tolist(), "radius": max(0.5 * float(np.linalg.norm(high - low)), 1e-6)}


@cache
def viewer_parts() -> dict[str, str]:
    """Scripts and style of pages with panes."""
    folder = files("yarnscale.show").joinpath("viewer")
    names = {"library": "three.min.js", "script": "viewer.js", "style": "viewer.css"}
    return {part: folder.joinpath(name).read_text("utf-8") for part, name in names.items()}


@cache
def _colour_map() -> tuple[str, ...]:
    import matplotlib
    from matplotlib.colors import to_hex

    colours = matplotlib.colormaps[theme.SEQUENTIAL]
    return tuple(to_hex(colours(share)) for share in np.linspace(0.0, 1.0, 17))

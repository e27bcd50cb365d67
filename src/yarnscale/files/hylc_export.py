"""Writer of the layout that was published with HYLC20 ("HYLC JSON").

The layout holds one- and two-dimensional Hermite splines of normalised strains x = strain / scale, continued along
straight lines. The sampled range and the provenance have no place in it.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from yarnscale.files.atomic import write_text
from yarnscale.shell.materials.spline_material import SplineMaterial
from yarnscale.shell.materials.spline_patches import AXES
from yarnscale.shell.materials.tables import CubicSpline

Array = NDArray[np.float64]

STRAIN_SHIFT = (1, 0, 1, 0, 0)
"""The published programs subtract these from (√I11, I12/√(I11 I22), √I22, λ_x, λ_y) to get strains."""


def write_hylc_json(path: str | Path, material: SplineMaterial) -> None:
    """Write a material as HYLC JSON, whole or not at all; InputError where the file cannot be written."""
    write_text(path, hylc_text(material))


def hylc_text(material: SplineMaterial) -> str:
    """The HYLC JSON of a material."""
    return json.dumps(hylc_content(material), allow_nan=False) + "\n"


def hylc_content(material: SplineMaterial) -> dict[str, object]:
    """The JSON object of a material; strains are normalised by the scale it was read with, or by its range."""
    scale = _scale(material)
    terms: dict[str, object] = {
        "const": material.constant,
        "1D": [_axis(k, f, scale[k]) for k, f in enumerate(material.axes)],
        "2D": [
            {
                "k0": i,
                "k1": j,
                "tu": (f.knots_u / scale[i]).tolist(),
                "tv": (f.knots_v / scale[j]).tolist(),
                # Rows of the file go along the second strain.
                "p": f.values.T.ravel().tolist(),
                "mu": (f.slopes_u * scale[i]).T.ravel().tolist(),
                "mv": (f.slopes_v * scale[j]).T.ravel().tolist(),
                "muv": (f.twists * scale[i] * scale[j]).T.ravel().tolist(),
            }
            for (i, j), f in material.planes.items()
        ],
    }
    return {
        "density": material.density,
        "strain scale": scale.tolist(),
        "strain shift": list(STRAIN_SHIFT),
        "coeffs": terms,
    }


def _scale(material: SplineMaterial) -> Array:
    stored = material.provenance.get("strain_scale")
    if (
        isinstance(stored, list)
        and len(stored) == len(AXES)
        and all(isinstance(x, float) and x > 0 for x in stored)
    ):
        return np.array(stored)
    return np.max(np.abs(material.range), axis=1)


def _axis(axis: int, spline: CubicSpline, scale: float) -> dict[str, object]:
    return {
        "k": axis,
        "t": (spline.knots / scale).tolist(),
        "p": spline.values.tolist(),
        "m": (spline.slopes * scale).tolist(),
    }

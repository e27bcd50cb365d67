"""Source of a compact material for other people's engines: a C file with one function, or a function of NVIDIA Warp.

The templates are in ``templates``. C takes no memory; Warp differentiates its function and runs it on a GPU.
"""

from __future__ import annotations

import re
from itertools import accumulate
from pathlib import Path
from typing import Literal

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from yarnscale.arrays import Array
from yarnscale.files.atomic import write_text
from yarnscale.shell.materials.compact import MIRROR, CompactMaterial

_TEMPLATES = {"c": "energy.c", "warp": "energy_warp.jinja"}
Language = Literal["c", "warp"]


def write_energy_source(path: str | Path, material: CompactMaterial, language: Language) -> None:
    """Write the source of a material, whole or not at all; InputError where the file cannot be written."""
    write_text(path, energy_source(material, language))


def energy_source(material: CompactMaterial, language: Language) -> str:
    """C99: ``int yarnscale_energy(strain[6], *energy, gradient[6], hessian[36])``. Warp: ``yarnscale_energy(strain,
    numbers)``, a ``wp.func`` of float64, and its ``NUMBERS``."""
    springs = material.springs
    name = re.sub(r"[^\w .,()+-]", "_", str(material.provenance.get("pattern", "")))[:80]
    images = np.array([np.ones(6), MIRROR] if material.mirrored else [np.ones(6)])
    arrays = {"inverse_scale": 1.0 / material.scale, **springs._asdict()}
    places = accumulate((array.size for array in arrays.values()), initial=0)
    environment = Environment(
        loader=PackageLoader("yarnscale.files", "templates"), undefined=StrictUndefined, trim_blocks=True,
        keep_trailing_newline=True,
    )  # fmt: skip
    environment.filters["rows"] = _rows
    return environment.get_template(_TEMPLATES[language]).render(
        title=f": {name}" if name else "", density=f"{material.density:.9g}", constant=repr(float(material.constant)),
        mirrored=material.mirrored, images=images, springs=springs, first=dict(zip(arrays, places, strict=False)),
        arrays={**springs._asdict(), "inverse_scale": arrays["inverse_scale"], "images": images},
        numbers=np.concatenate([array.ravel() for array in arrays.values()]),
    )  # fmt: skip


def _rows(values: Array) -> list[str]:
    """Numbers with all their digits, six on a line."""
    flat = values.ravel()
    return [", ".join(repr(float(v)) for v in flat[k : k + 6]) for k in range(0, len(flat), 6)]

"""Python source of a compact material as a function of NVIDIA Warp, which differentiates it and runs it on a GPU."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from yarnscale.files.atomic import write_text
from yarnscale.shell.materials.compact import MIRROR, CompactMaterial

Array = NDArray[np.float64]


def write_warp_source(path: str | Path, material: CompactMaterial) -> None:
    """Write a Python file of a material, whole or not at all; InputError where the file cannot be written."""
    write_text(path, warp_source(material))


def warp_source(material: CompactMaterial) -> str:
    """The source of ``yarnscale_energy(strain, numbers)``, a ``wp.func`` of float64, and of its ``NUMBERS``."""
    springs = material.springs
    name = re.sub(r"[^\w .,()+-]", "_", str(material.provenance.get("pattern", "")))[:80]
    images = [np.ones(6), MIRROR] if material.mirrored else [np.ones(6)]
    arrays = {"inverse_scale": 1.0 / material.scale, "images": np.array(images), **springs._asdict()}
    places, first = {}, 0
    for key, array in arrays.items():
        places[key] = first
        first += array.size
    flat = np.concatenate([array.ravel() for array in arrays.values()])
    rows = [", ".join(repr(float(v)) for v in flat[k : k + 6]) for k in range(0, len(flat), 6)]
    counts = {
        "IMAGES": len(images), "RAMPS": len(springs.ramps), "SPRINGS": len(springs.springs),
        "WALLS": len(springs.walls),
    }  # fmt: skip
    body = _BODY.replace("CONSTANT", repr(float(material.constant)))
    for key, place in places.items():
        body = body.replace(f"<{key}>", str(place))
    for key, count in counts.items():
        body = body.replace(f"<{key}>", str(count))
    head = _HEAD.replace("<name>", f": {name}" if name else "").replace(
        "<density>", f"{material.density:.9g}"
    )
    return head + "NUMBERS = [\n    " + ",\n    ".join(rows) + ",\n]\n" + body


_HEAD = '''\
"""Energy density of a shell material<name>, written by yarnscale for NVIDIA Warp.

yarnscale_energy(strain, numbers) returns the energy [J/m^2] per rest area of the strain
(s_x, s_a, s_y, II11, II12, II22): s_x = sqrt(I11) - 1, s_a = I12/sqrt(I11 I22), s_y = sqrt(I22) - 1, II [1/m].
numbers: wp.array(NUMBERS, dtype=wp.float64). Warp differentiates it. density: <density> kg/m^2.
"""

import warp as wp

vec6 = wp.types.vector(length=6, dtype=wp.float64)

'''

_BODY = """

@wp.func
def yarnscale_ramp(u: wp.float64):
    return wp.float64(0.5) * (u + wp.sqrt(wp.float64(1.0) + u * u))


@wp.func
def yarnscale_energy(strain: vec6, numbers: wp.array(dtype=wp.float64)):
    psi = wp.float64(0.0)
    for m in range(<IMAGES>):
        for i in range(6):
            x = strain[i] * numbers[<inverse_scale> + i]
            psi += wp.float64(0.5) * numbers[<background> + i] * x * x
        for k in range(<SPRINGS>):
            u = numbers[<spring_offsets> + k]
            for i in range(6):
                x = strain[i] * numbers[<inverse_scale> + i] * numbers[<images> + 6 * m + i]
                u += numbers[<springs> + 6 * k + i] * x
            for j in range(<RAMPS>):
                a = numbers[<ramp_offsets> + j]
                for i in range(6):
                    x = strain[i] * numbers[<inverse_scale> + i] * numbers[<images> + 6 * m + i]
                    a += numbers[<ramps> + 6 * j + i] * x
                u += numbers[<bends> + <RAMPS> * k + j] * yarnscale_ramp(a)
            r = yarnscale_ramp(u)
            psi += numbers[<stiffnesses> + k] * r * r
        for k in range(<WALLS>):
            u = -numbers[<wall_offsets> + k]
            for i in range(6):
                x = strain[i] * numbers[<inverse_scale> + i] * numbers[<images> + 6 * m + i]
                u += numbers[<walls> + 6 * k + i] * x
            u = wp.max(u, wp.float64(0.0))
            psi += numbers[<wall_stiffnesses> + k] * u * u * u
    return wp.float64(CONSTANT) + psi / wp.float64(<IMAGES>)
"""

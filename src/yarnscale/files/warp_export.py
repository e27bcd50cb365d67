"""Python source of a compact material as a function of NVIDIA Warp, which differentiates it and runs it on a GPU."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from yarnscale.files.atomic import write_text
from yarnscale.shell.materials.compact import CompactMaterial


def write_warp_source(path: str | Path, material: CompactMaterial) -> None:
    """Write a Python file of a material, whole or not at all; InputError where the file cannot be written."""
    write_text(path, warp_source(material))


def warp_source(material: CompactMaterial) -> str:
    """The source of ``yarnscale_energy(strain, numbers)``, a ``wp.func`` of float64, and of its ``NUMBERS``."""
    springs = material.springs
    name = re.sub(r"[^\w .,()+-]", "_", str(material.provenance.get("pattern", "")))[:80]
    arrays = {"inverse_scale": 1.0 / material.scale, **springs._asdict()}
    places, first = {}, 0
    for key, array in arrays.items():
        places[key] = first
        first += array.size
    flat = np.concatenate([array.ravel() for array in arrays.values()])
    rows = [", ".join(repr(float(v)) for v in flat[k : k + 6]) for k in range(0, len(flat), 6)]
    image, mirror = "yarnscale_image({}, numbers)", "vec6(x[0], -x[1], x[2], x[3], -x[4], x[5])"
    counts = {
        "STEPS": len(springs.steps), "SPRINGS": len(springs.springs), "WALLS": len(springs.walls),
        "CONSTANT": repr(float(material.constant)),
        "IMAGES": f"wp.float64(0.5) * ({image.format('x')} + {image.format(mirror)})"
        if material.mirrored
        else image.format("x"),
    }  # fmt: skip
    body = _BODY
    for key, value in (*places.items(), *counts.items()):
        body = body.replace(f"<{key}>", str(value))
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
def yarnscale_six(numbers: wp.array(dtype=wp.float64), k: int):
    return vec6(numbers[k], numbers[k + 1], numbers[k + 2], numbers[k + 3], numbers[k + 4], numbers[k + 5])


@wp.func
def yarnscale_tightness(x: vec6, numbers: wp.array(dtype=wp.float64), k: int):
    u = numbers[<spring_offsets> + k] + wp.dot(x, yarnscale_six(numbers, <springs> + 6 * k))
    for j in range(<STEPS>):
        a = numbers[<step_offsets> + j] + wp.dot(x, yarnscale_six(numbers, <steps> + 6 * j))
        u += numbers[<bends> + <STEPS> * k + j] * a / wp.sqrt(wp.float64(1.0) + a * a)
    return u


@wp.func
def yarnscale_spring(u: wp.float64):
    r = wp.float64(0.5) * (u + wp.sqrt(wp.float64(1.0) + u * u))
    share = r / (wp.float64(1.0) + r)
    return r * r * share * share * share * share


@wp.func
def yarnscale_wall(u: wp.float64):
    positive = wp.max(u, wp.float64(0.0))
    return positive * positive * positive


@wp.func
def yarnscale_image(x: vec6, numbers: wp.array(dtype=wp.float64)):
    psi = wp.float64(0.0)
    for k in range(<SPRINGS>):
        psi += numbers[<stiffnesses> + k] * yarnscale_spring(yarnscale_tightness(x, numbers, k))
    for k in range(<WALLS>):
        u = wp.dot(x, yarnscale_six(numbers, <walls> + 6 * k)) - numbers[<wall_offsets> + k]
        psi += numbers[<wall_stiffnesses> + k] * yarnscale_wall(u)
    return psi


@wp.func
def yarnscale_energy(strain: vec6, numbers: wp.array(dtype=wp.float64)):
    x = wp.cw_mul(strain, yarnscale_six(numbers, <inverse_scale>))
    soft = wp.float64(0.5) * yarnscale_six(numbers, <background>)
    return wp.float64(<CONSTANT>) + wp.dot(soft, wp.cw_mul(x, x)) + <IMAGES>
"""

"""Strips of Newton's cloth beside the material that its parameters were fitted to.

python benchmarks/newton_strip.py MATERIAL.json [...]   (needs newton, of the extra dev; some ten seconds a material)

A strip of 10 × 3 cm is pulled by 1 N/m; another one, clamped at one end, hangs under a thirtieth of its weight, so that
its deflection is that of a slender beam. Stretch and bending length (B/w)^(1/3) are beside those of the material's
virtual tests. Deflections approach rest geometrically: the last three give the limit.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yarnscale.files.material_json import read_material
from yarnscale.kinematics import GRAVITY
from yarnscale.laboratory.style3d import Style3DCloth, fit_style3d

PULL = 1.0
LIGHTER = 30.0
STEP = 1 / 60


def strip(
    cloth: Style3DCloth, length: float, *, cells: int, clamped: int, pull: float = 0.0, gravity: float = 0.0,
    steps: int, every: int = 50,
) -> list[NDArray[np.float64]]:  # fmt: skip
    """Mean places [m] of the free end, every some steps; clamped: columns of vertices that are held."""
    import newton
    import warp as wp
    from newton.solvers import style3d

    wp.config.quiet = True
    edge, across = length / cells, max(3, cells // 3)
    count = (cells + 1) * (across + 1)
    mass = cloth.density * cells * across * edge**2 / count
    builder: Any = newton.ModelBuilder(up_axis=newton.Axis.Z)
    newton.solvers.SolverStyle3D.register_custom_attributes(builder)
    style3d.add_cloth_grid(
        builder, pos=wp.vec3(0, 0, 0), rot=wp.quat_identity(), vel=wp.vec3(0, 0, 0), dim_x=cells, dim_y=across,
        cell_x=edge, cell_y=edge, mass=mass, tri_aniso_ke=wp.vec3(*cloth.stretch),
        edge_aniso_ke=wp.vec3(*cloth.bend),
    )  # fmt: skip
    model = builder.finalize(device="cpu")
    column = np.arange(count) % (cells + 1)
    flags = model.particle_flags.numpy()
    flags[column < clamped] &= ~int(newton.ParticleFlags.ACTIVE)
    model.particle_flags = wp.array(flags, device="cpu")
    model.set_gravity((0.0, 0.0, -gravity))
    config = newton.solvers.SolverStyle3D.Config(iterations=10, linear_iterations=30)
    solver = newton.solvers.SolverStyle3D(model=model, config=config)
    solver.collision = None
    end = np.flatnonzero(column == cells)
    shares = np.ones(len(end))
    shares[[0, -1]] = 0.5
    forces = np.zeros((count, 3), np.float32)
    forces[end, 0] = pull * edge * shares
    here, there, places = model.state(), model.state(), []
    for step in range(1, steps + 1):
        here.particle_f.assign(forces)
        solver.step(here, there, model.control(), None, STEP)
        here, there = there, here
        if step % every == 0:
            places.append(np.asarray(here.particle_q.numpy()[end].mean(axis=0), np.float64))
    return places


def stretched(cloth: Style3DCloth, pull: float = PULL) -> float:
    """Stretch of a strip along the weft under a load [N/m]."""
    return float(strip(cloth, 0.1, cells=20, clamped=1, pull=pull, steps=50)[-1][0] / 0.1 - 1)


def bending_length(cloth: Style3DCloth, expected: float) -> float:
    """Bending length [m] of a strip along the weft, of about twice the ``expected`` one."""
    cells, gravity = 20, GRAVITY / LIGHTER
    length = 2 * expected
    # Two columns of vertices hold the slope of the clamped end.
    places = strip(cloth, length * (cells + 1) / cells, cells=cells + 1, clamped=2, gravity=gravity, steps=300)
    first, second, third = (-place[2] for place in places[-3:])
    limit = third + (third - second) ** 2 / ((second - first) - (third - second))
    rigidity = cloth.density * gravity * length**4 / (8 * limit)
    return float((rigidity / (cloth.density * GRAVITY)) ** (1 / 3))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("materials", nargs="+", type=Path)
    print("| material | stretch under 1 N/m: material, Newton | error | bending length [mm] | error |")
    print("|---|---|---|---|---|")
    for path in parser.parse_args().materials:
        fit = fit_style3d(read_material(path))
        loads, own = np.array([(p.load, p.stretch) for p in fit.tests.pulled(0.0)]).T
        stretch, found = float(np.interp(PULL, loads, own)), stretched(fit.cloth)
        rigidity = next(s.B for s in fit.tests.bend if s.direction == 0.0)
        assert rigidity is not None
        length = (rigidity / (fit.cloth.density * GRAVITY)) ** (1 / 3)
        bent = bending_length(fit.cloth, length)
        print(
            f"| {path.parent.name} | {stretch:.4f}, {found:.4f} | {100 * (found / stretch - 1):+.0f} % "
            f"| {1e3 * length:.1f}, {1e3 * bent:.1f} | {100 * (bent / length - 1):+.0f} % |",
            flush=True,
        )

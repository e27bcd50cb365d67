"""A knit stretched yarn by yarn against its periodic cell, away from the edges: stress and narrowing.

python benchmarks/direct_stretch.py [size in m] [stretch] [vertices per stitch, such as 27,40] [friction, such as 0,0.3]

Stockinette between two grips along its wales that let it narrow. The cell is taken at the strain, the curvature and the
yarn per stitch that the stitches inside the sheet have. Its narrowing is that at their stress across.
Without friction the sheet begins in the state of the cell, with friction at rest, in steps of 5 %.
"""

from __future__ import annotations

import math
import sys
import time
from dataclasses import replace

import numpy as np
from knit_interior import interior
from scipy.optimize import root, root_scalar

from yarnscale.cell import PeriodicCell
from yarnscale.drawing import library
from yarnscale.fabric.boundary import glue
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_friction import FrictionHistory
from yarnscale.fabric.direct_static import Rest, rod_equilibrium, safe_path
from yarnscale.fabric.holds import Holds
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.kinematics import ShellStrain
from yarnscale.numerics.kkt import ConstrainedSolver
from yarnscale.yarn.friction import YarnFriction
from yarnscale.yarn.material import YarnMaterial
from yarnscale.yarn.pattern import YarnPattern

GRIP = 0.005
"""Width of either grip [m]."""


def stockinette(vertices: int) -> tuple[YarnPattern, YarnMaterial]:
    pattern = library.build("stockinette", vertices_per_stitch=vertices)
    material = YarnMaterial.preset(library.structure("stockinette").material)
    # Segments that touch along one yarn are as far apart as at 27 vertices a stitch.
    contact = replace(material.contact, neighbours=math.ceil(material.contact.neighbours * vertices / 27))
    return pattern, replace(material, contact=contact)


def narrowing(cell: PeriodicCell, strain: ShellStrain, across: float) -> float:
    """Strain along the wales at which the cell has the stress ``across`` [N/m] there."""

    def excess(s_y: float) -> float:
        return float(cell.relax(replace(strain, s_y=s_y)).stress[2]) - across

    return float(root_scalar(excess, bracket=(strain.s_y - 0.05, strain.s_y + 0.05), xtol=1e-4).root)


def stretch_at(cell: PeriodicCell, strain: ShellStrain, stress: np.ndarray) -> float:
    """Strain along the courses at which the cell has both stresses (2,) [N/m]."""

    def excess(s: np.ndarray) -> np.ndarray:
        return cell.relax(replace(strain, s_x=float(s[0]), s_y=float(s[1]))).stress[[0, 2]] - stress

    return float(root(excess, [strain.s_x, strain.s_y], options={"xtol": 1e-4}).x[0])


def measure(size: float, amount: float, vertices: int, friction: float) -> None:
    pattern, material = stockinette(vertices)
    cell = PeriodicCell(pattern, material)
    first = ShellStrain() if friction else ShellStrain(s_x=amount, s_y=-0.12 * amount / 0.2)
    if not friction:
        first = replace(first, s_y=narrowing(cell, first, 0.0))
    rest = cell.relax()
    whole = YarnSheet.filling(pattern, size, size)
    width = whole.size[0]
    whole = whole.moved(cell.placement(rest)(whole.source, whole.tile), twist=rest.twist[whole.source])
    rows = np.minimum(whole.tile[:, 1], whole.tile[:, 1].max() - whole.tile[:, 1])
    springs = glue(whole, material, distance=rows * whole.radius, width=0.5 * whole.radius, stiffness=0.05)
    energy = FabricEnergy(whole, material, springs=springs)
    places = whole.vertices
    low, high = places[:, 0].min(), places[:, 0].max()
    left, right = np.flatnonzero(places[:, 0] < low + GRIP), np.flatnonzero(places[:, 0] > high - GRIP)
    nodes = np.concatenate([left, right])
    side = np.repeat([-1.0, 1.0], [len(left), len(right)])
    between = high - low - 2.0 * GRIP

    def holds(share: float) -> Holds:
        targets = places[nodes].copy()
        targets[:, 0] += 0.5 * share * between * side
        return Holds(nodes, targets, (True, False, True))

    def ahead(x: np.ndarray, before: float, share: float) -> np.ndarray:
        goal = x.copy()
        points = energy.positions(goal)
        points[:, 0] *= (1.0 + share) / (1.0 + before)
        points[:, 0] += 0.5 * (places[nodes][:, 0].min() + places[nodes][:, 0].max()) / energy.radius - (
            0.5 * (points[nodes, 0].min() + points[nodes, 0].max())
        )
        return goal

    start, shares = energy.start(), np.arange(0.05, amount + 1e-9, 0.05)
    energy.count_passages()
    if not friction:
        state = cell.relax(first)
        goal = cell.placement(state)(whole.source, whole.tile)
        goal = goal + (places.mean(axis=0) - goal.mean(axis=0))
        start = safe_path(energy, start, energy.vector(goal, state.twist[whole.source]))
        shares, ahead_of = np.array([amount]), None
    else:
        ahead_of = ahead
    began = time.perf_counter()

    def told(share: float, found: Rest) -> None:
        inside = interior(pattern, energy, found.x, share=0.5)
        own = PeriodicCell(replace(pattern, rest_length=pattern.rest_length * inside.yarn), material)
        bent = own.relax(inside.strain)
        flat = replace(inside.strain, II11=0.0, II12=0.0, II22=0.0)
        even = own.relax(flat)
        narrow = narrowing(own, flat, float(inside.stress[1]))
        s, reach = inside.strain, stretch_at(own, flat, inside.stress)
        print(
            f"{vertices:3d} vertices, friction {friction:g}, grips {share:.2f}: {found.status.name} "
            f"({found.residual:.1e}) {found.iterations} iterations, {time.perf_counter() - began:.0f} s, "
            f"passages {energy.passage_count}\n"
            f"  strain {s.s_x:.4f} {s.s_y:.4f} shear {s.s_a:.4f} bend {s.II11:.2f} {s.II22:.2f} /m, "
            f"yarn {inside.yarn:.4f} (slid {inside.slid:.4f}), {inside.stitches} stitches\n"
            f"  stress {inside.stress[0]:.4f} {inside.stress[1]:.4f}; "
            f"cell bent {bent.stress[0]:.4f} {bent.stress[2]:.4f}, "
            f"flat {even.stress[0]:.4f} {even.stress[2]:.4f} N/m: {inside.stress[0] / bent.stress[0] - 1:+.1%}\n"
            f"  energy {inside.energy:.5f}; cell bent {bent.energy_density:.5f}, flat {even.energy_density:.5f} J/m²\n"
            f"  narrowing {s.s_y:.4f}; cell at the same stress across {narrow:.4f}: {s.s_y / narrow - 1:+.1%}\n"
            f"  stretch {s.s_x:.4f}; cell at the same stresses {reach:.4f}: {s.s_x / reach - 1:+.1%}",
            flush=True,
        )

    print(f"{width:g} m, {whole.vertex_count} vertices", flush=True)
    x, before, solver, history = start, 0.0, ConstrainedSolver(), FrictionHistory.slack(energy)
    for share in shares:
        step = history.begin(energy, YarnFriction(friction), x)
        if ahead_of is not None:
            x = safe_path(energy, x, ahead_of(x, before, float(share)))
        rest = rod_equilibrium(energy, x, holds(float(share)), tolerance=2e-4, max_iterations=300, linear=solver)
        x, before, history = rest.x, float(share), step.end(rest.x)
        told(before, rest)


if __name__ == "__main__":
    given = dict(enumerate(sys.argv[1:]))
    for number in given.get(2, "27,40").split(","):
        for coefficient in given.get(3, "0,0.3").split(","):
            measure(float(given.get(0, "0.1")), float(given.get(1, "0.2")), int(number), float(coefficient))

"""Curl of stockinette, yarn by yarn and as homogenized cloth: how high its edges rise over the middle, to which side.

python benchmarks/curl.py [size in m] [equilibria] [picture]

A free piece, and cloth of the material of tests/fabrics, which was homogenized
from the same yarns at rest. Without friction the cut yarns draw back into the piece, which relaxes and curls little; so
the direct piece creeps with a little friction, from equilibrium to equilibrium.
"""

from __future__ import annotations

import sys
import time
from importlib import import_module
from pathlib import Path

import numpy as np
from knit_interior import interior

from yarnscale.cell import PeriodicCell
from yarnscale.cell.rest import settled
from yarnscale.drawing import library
from yarnscale.fabric.boundary import glue
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_friction import FrictionHistory
from yarnscale.fabric.direct_static import rod_equilibrium
from yarnscale.fabric.holds import Holds
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.files.material_json import read_material
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.shell.contact.cloth_contact import ContactSettings
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver
from yarnscale.shell.mesh import TriangleMesh, rectangle
from yarnscale.shell.state import ClothState
from yarnscale.yarn.friction import YarnFriction
from yarnscale.yarn.material import YarnMaterial

FABRICS = Path(__file__).resolve().parents[1] / "tests" / "fabrics"
SETTING = 0.8
"""As in tests/fabrics/make.py."""
FRICTION = 0.05
EDGE = 0.004
"""Width of what counts as an edge [m]."""


def upright(flat: np.ndarray, shape: np.ndarray) -> tuple[np.ndarray, dict[str, float]]:
    """The shape (n, 3) [m] with its middle level at the origin, and heights of the middles of its edges [mm]."""
    place = flat[:, :2] - 0.5 * (flat[:, :2].min(axis=0) + flat[:, :2].max(axis=0))
    half = np.abs(place).max(axis=0)
    middle = np.abs(place).max(axis=1) < 0.006
    rows = np.column_stack([place[middle], np.ones(middle.sum())])
    slope = np.linalg.lstsq(rows, shape[middle], rcond=None)[0]
    normal = np.cross(slope[0], slope[1])
    normal /= np.linalg.norm(normal)
    along = slope[0] / np.linalg.norm(slope[0])
    turned = (shape - shape[middle].mean(axis=0)) @ np.stack([along, np.cross(normal, along), normal], axis=1)
    heights = {}
    for name, axis, side in (("bottom", 1, -1), ("top", 1, 1), ("left", 0, -1), ("right", 0, 1)):
        near = (side * place[:, axis] > half[axis] - EDGE) & (np.abs(place[:, 1 - axis]) < 0.01)
        heights[name] = 1e3 * float(turned[near, 2].mean())
    return turned, heights


def told(heights: dict[str, float]) -> str:
    return ", ".join(f"{name} {height:+.1f}" for name, height in heights.items()) + " mm"


def direct(size: float, equilibria: int) -> tuple[YarnSheet, np.ndarray]:
    material = YarnMaterial.preset(library.structure("stockinette").material)
    pattern = settled(library.build("stockinette"), material, setting=SETTING).pattern
    cell = PeriodicCell(pattern, material)
    state = cell.relax()
    sheet = YarnSheet.filling(pattern, size, size)
    sheet = sheet.moved(cell.placement(state)(sheet.source, sheet.tile), twist=state.twist[sheet.source])
    energy = FabricEnergy(sheet, material, springs=glue(sheet, material))
    x = energy.start()
    energy.count_passages()
    began = time.perf_counter()
    tile = sheet.tile - np.median(sheet.tile, axis=0)
    nodes = np.flatnonzero((np.abs(tile) <= 1).all(axis=1) & (sheet.source == 5))[:3]
    history = FrictionHistory.slack(energy)
    for number in range(equilibria):
        step = history.begin(energy, YarnFriction(FRICTION), x)
        holds = Holds(nodes, sheet.vertices[nodes])
        x = rod_equilibrium(energy, x, holds, tolerance=1e-3, max_iterations=25).x
        history = step.end(x)
        if (number + 1) % 25 == 0:
            inside = interior(pattern, energy, x, share=0.5)
            shape, heights = upright(sheet.vertices, energy.positions(x) * sheet.radius)
            print(
                f"direct {number + 1}: {told(heights)}; all {1e3 * float(np.ptp(shape[:, 2])):.1f} mm; bend "
                f"{inside.strain.II11:.1f} {inside.strain.II22:.1f} /m, yarn {inside.yarn:.4f}, "
                f"passages {energy.passage_count}, {1e6 * energy.value(x) * energy.unit:.2f} µJ, "
                f"{time.perf_counter() - began:.0f} s",
                flush=True,
            )
    return sheet, upright(sheet.vertices, energy.positions(x) * sheet.radius)[0]


def homogenized(size: tuple[float, float]) -> tuple[TriangleMesh, np.ndarray]:
    mesh = rectangle(*size, 0.0025)
    material = read_material(FABRICS / "stockinette.json")
    cloth = Cloth(mesh, material, gravity=(0, 0, 0), contact=ContactSettings(thickness=5e-4), damping=5.0)
    states: list[ClothState] = []
    schedule = Schedule(1.0, 0.02, to_rest=False, frame_interval=1.0)
    simulate(ClothSolver(cloth), ClothState.flat(mesh), schedule, on_frame=lambda _, s: states.append(s))
    shape, heights = upright(mesh.material, states[-1].positions)
    print(f"homogenized: {told(heights)}; all {1e3 * float(np.ptp(shape[:, 2])):.1f} mm", flush=True)
    return mesh, shape


def draw(path: Path, piece: YarnSheet, yarns: np.ndarray, mesh: TriangleMesh, surface: np.ndarray) -> None:
    """Both side by side, seen from the lower right."""
    from yarnscale.files.animation import Animation, Moment, Surface
    from yarnscale.show.curves import Curve
    from yarnscale.show.run_page import frames_picture
    from yarnscale.show.tubes import yarn_picture

    parts = [path.with_name(f"{path.stem}-{side}.png") for side in ("yarns", "cloth")]
    ends = zip(piece.offsets[:-1], piece.offsets[1:], strict=True)
    curves = [Curve(yarns[a:b], number) for number, (a, b) in enumerate(ends)]
    camera, size = (0.45, -1.0, 0.55), (580, 451)
    yarn_picture(parts[0], curves, piece.radius, camera=camera, size=size)
    cloth = Animation(np.zeros(1), lambda _: Moment(0.0, cloth=surface), Surface(mesh.triangles))
    frames_picture(parts[1], cloth, camera=camera, size=size, titles=[" "])
    image = import_module("matplotlib.image")
    image.imsave(path, np.concatenate([image.imread(part)[:, :, :3] for part in parts], axis=1))
    for part in parts:
        part.unlink()


if __name__ == "__main__":
    given = dict(enumerate(sys.argv[1:]))
    piece, yarns = direct(float(given.get(0, "0.06")), int(given.get(1, "100")))
    mesh, surface = homogenized(piece.size)
    if 2 in given:
        draw(Path(given[2]), piece, yarns, mesh, surface)

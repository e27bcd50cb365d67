"""Energy and shape of the sheet scenes over the spacing of their meshes: stretch, drape and curl.

Run ``python benchmarks/refinement.py [MATERIAL.json] [--spacings 13 9 6.5 4.5] [--scenes drape curl]``; spacings
in mm; without a file, stockinette of tests/fabrics. Seconds are of the processor.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from yarnscale.files.material_json import read_material
from yarnscale.motion.handles import Handle
from yarnscale.motion.scene import run_scene
from yarnscale.motion.schedule import Schedule
from yarnscale.shell.contact.cloth_contact import ContactSettings
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver, SolverOptions
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.mesh import rectangle
from yarnscale.shell.scenes.scene import Scene, stretch
from yarnscale.shell.scenes.sheet_scenes import drape_on_ball
from yarnscale.shell.state import ClothState

THICKNESS = 1.5e-3
"""Of contact, the same on every mesh [m]."""
STOCKINETTE = Path(__file__).resolve().parents[1] / "tests" / "fabrics" / "stockinette.json"


def stretching(material: ShellMaterial, spacing: float) -> Scene:
    """The published pull of stockinette along its course."""
    scene = stretch(material, travel=0.035, spacing=spacing)
    return replace(scene, cloth=replace(scene.cloth, contact=ContactSettings(THICKNESS)))


def draping(material: ShellMaterial, spacing: float) -> Scene:
    """The published drape, brought to rest."""
    scene = drape_on_ball(material, spacing=spacing)
    contact = ContactSettings(THICKNESS, friction=0.0)
    schedule = Schedule(0.8, 1 / 30, rough_iterations=30)
    return replace(scene, cloth=replace(scene.cloth, contact=contact), schedule=schedule)


def curling(material: ShellMaterial, spacing: float, *, finer_edges: float = 0.0) -> Scene:
    """A weightless strip of 12 × 6 cm, held along its short sides, whose long sides roll."""
    mesh = rectangle(0.12, 0.06, spacing, finer_edges=finer_edges)
    start = ClothState.flat(mesh)
    ends = np.flatnonzero(np.abs(mesh.panel[:, 0]) > 0.06 - 1e-9)
    held = Handle("ends", ends, start.positions[ends])
    contact = ContactSettings(min(THICKNESS, 0.4 * spacing))
    cloth = Cloth(mesh, material, (held,), gravity=(0, 0, 0), contact=contact, damping=3.0)
    return Scene("curl", cloth, start, Schedule(0.4, 1 / 30, rough_iterations=30), SolverOptions())


SCENES: Mapping[str, Callable[[ShellMaterial, float], Scene]] = {
    "stretch": stretching,
    "drape": draping,
    "curl": curling,
    "curl, finer edges": partial(curling, finer_edges=0.5),
}


def curvature(solver: ClothSolver, state: ClothState, share: float) -> float:
    """Largest principal curvature that ``share`` of the area does not exceed [1/m]."""
    elements = solver.energy.elements
    elements.follow(state.positions)
    # Blocks are padded with elements of no area.
    forms = elements.forms(state.positions).transpose(1, 0, 2).reshape(6, -1)
    middle, half = 0.5 * (forms[3] + forms[5]), np.hypot(0.5 * (forms[3] - forms[5]), forms[4])
    largest = np.abs(middle) + half
    order = np.argsort(largest)
    area = np.cumsum(elements.areas.ravel()[order])
    return float(largest[order][np.searchsorted(area, share * area[-1])])


def main() -> None:
    """A table for each scene."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("material", nargs="?", default=STOCKINETTE)
    parser.add_argument("--spacings", type=float, nargs="*", default=[13.0, 9.0, 6.5, 4.5], help="[mm]")
    parser.add_argument("--scenes", nargs="+", choices=tuple(SCENES), default=list(SCENES))
    arguments = parser.parse_args()
    material = read_material(arguments.material)
    for name in arguments.scenes:
        print(
            f"{name}\n{'mm':>6}{'vertices':>9}{'elastic mJ':>12}{'all mJ':>10}{'low mm':>8}{'high mm':>8}",
            end="",
        )
        print(f"{'along':>8}{'across':>8}{'90 % 1/m':>10}{'99 % 1/m':>10}{'seconds':>9}  ended")
        for spacing in arguments.spacings:
            scene = SCENES[name](material, 1e-3 * spacing)
            begin = time.process_time()
            result = run_scene(scene)
            spent, state, mesh = time.process_time() - begin, result.state, scene.cloth.mesh
            solver = ClothSolver(scene.cloth, scene.options)
            energies, rest = solver.energies(state), ClothSolver(scene.cloth).energies(scene.start)
            elastic = energies["elastic"] - rest["elastic"]
            total = elastic + energies["gravity"] - rest["gravity"]
            low, high = 1e3 * state.positions[:, 2].min(), 1e3 * state.positions[:, 2].max()
            measures = result.measures
            stretches = [measures.get(key, float("nan")) for key in ("lambda_along", "lambda_across")]
            bends = [curvature(solver, state, share) for share in (0.9, 0.99)]
            print(
                f"{spacing:6.2f}{mesh.vertex_count:9}{1e3 * elastic:12.4g}{1e3 * total:10.4g}{low:8.2f}{high:8.2f}"
                f"{stretches[0]:8.4f}{stretches[1]:8.4f}{bends[0]:10.1f}{bends[1]:10.1f}{spent:9.1f}"
                f"  {result.run.outcome}",
                flush=True,
            )


if __name__ == "__main__":
    main()

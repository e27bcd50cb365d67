"""Least milliseconds of the parts of contact, with 5 000 and 20 000 triangles, and searches side by side.

Run ``python benchmarks/contact.py``. Two states: a sheet rolled up with its layers 0.7 mm apart (self-contact), and one
lying on a moving body of as many triangles (a body's contact).
"""

from __future__ import annotations

import time
from collections.abc import Callable

import ipctk
import numpy as np
from numpy.typing import NDArray

from yarnscale.motion.obstacles import MeshObstacle
from yarnscale.motion.rigid import Motion
from yarnscale.numerics.threads import available_threads
from yarnscale.shell.contact.broad_phase import near_pairs
from yarnscale.shell.contact.cloth_contact import ClothContact, ContactSettings
from yarnscale.shell.contact.surface_contact import SurfaceContact
from yarnscale.shell.mesh import TriangleMesh, rectangle

Floats = NDArray[np.float64]

SHEET = 0.3
SETTINGS = ContactSettings(friction=0.3)


def milliseconds(run: Callable[[], object], repeats: int = 5) -> float:
    run()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return 1e3 * min(times)


def rolled(mesh: TriangleMesh) -> tuple[ClothContact, Floats]:
    turn, gap = 0.02, 7e-4
    angle = mesh.panel[:, 0] / turn
    radius = turn + gap * angle / (2 * np.pi)
    positions = np.column_stack([radius * np.sin(angle), mesh.panel[:, 1], -radius * np.cos(angle)])
    return ClothContact(mesh, SETTINGS), positions


def lying(mesh: TriangleMesh) -> tuple[ClothContact, Floats]:
    """A sheet 0.7 mm above a body with bumps that turns about the vertical."""
    body = rectangle(1.1 * SHEET, 1.1 * SHEET, 1.1 * SHEET * np.sqrt(2.0 / len(mesh.triangles)))

    def bumps(panel: Floats, height: float) -> Floats:
        return np.column_stack([panel, 0.01 * np.sin(40 * panel[:, 0]) * np.sin(40 * panel[:, 1]) + height])

    motion = Motion((0.0, 0.0, 0.05), 0.0, 1.0, (0.0, 0.0, 1.0))
    obstacle = MeshObstacle(bumps(body.panel, 0.0), body.triangles, motion)
    contact = ClothContact(mesh, SETTINGS, (obstacle,))
    return contact, np.concatenate([bumps(mesh.panel, 7e-4), contact.places(0.0)])


def parts(contact: ClothContact, positions: Floats) -> None:
    surface = next(part for part in contact.parts if isinstance(part, SurfaceContact))
    rng = np.random.default_rng(0)
    step = 5e-4 * rng.standard_normal(positions.shape)
    contact.start_step(positions, 1 / 60)
    fraction = contact.bound(positions, step)
    points = [positions + share * fraction * step for share in (0.2, 0.4)]
    turn = 0

    def elsewhere() -> Floats:
        """Alternating places, so that nothing is remembered from the call before."""
        nonlocal turn
        turn += 1
        return points[turn % 2]

    tests: list[tuple[str, Callable[[], object]]] = [
        ("bound of a step, searched before", lambda: contact.bound(positions, step)),
        ("start of a step", lambda: contact.start_step(elsewhere(), 1 / 60)),
        ("energy at a new place (close pairs)", lambda: contact.value(elsewhere())),
        ("energy and gradient at a known place", lambda: contact.gradient(points[0])),
        ("Hessian at a known place", lambda: contact.hessian(points[0])),
        ("test of a frame", lambda: contact.intersects(positions)),
    ]
    contact.bound(positions, step)
    for text, run in tests:
        print(f"  {text:44}{milliseconds(run):9.1f}")
    search, everything = surface.search, surface.everything(positions)
    reach = 0.5 * SETTINGS.thickness + search.slack
    low, high = everything - reach, everything + reach
    cost = milliseconds(lambda: near_pairs(search.surfaces, low, high, within_cloth=True), 3)
    print(f"  {'search for pairs':44}{cost:9.1f}")
    faces = np.asfortranarray(search.surfaces.triangles.astype(np.int32))
    mesh = ipctk.CollisionMesh(np.asfortranarray(everything), ipctk.edges(faces), faces)
    found = ipctk.Candidates()
    cost = milliseconds(lambda: found.build(mesh, np.asfortranarray(everything), reach), 3)
    print(f"  {'the same by ipctk, bodies with themselves too':44}{cost:9.1f}")
    print(f"  {'close pairs':44}{len(search.close(everything).distances):9}")


def main() -> None:
    print(f"{available_threads()} threads; milliseconds")
    for spacing in (0.0065, 0.00325):
        mesh = rectangle(SHEET, SHEET, spacing)
        for name, build in (("rolled", rolled), ("on a moving body", lying)):
            contact, positions = build(mesh)
            print(f"{name}, {len(mesh.triangles)} triangles, {contact.guests} vertices of bodies")
            parts(contact, positions)


if __name__ == "__main__":
    main()

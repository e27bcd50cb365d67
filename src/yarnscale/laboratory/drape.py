"""The Cusick drape test (BS 5058, ISO 9073-9): a round specimen on a smaller disc hangs down in folds."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import find_peaks

from yarnscale.arrays import Array, Integers
from yarnscale.motion.handles import Handle
from yarnscale.motion.scene import run_scene
from yarnscale.motion.schedule import Schedule
from yarnscale.shell.contact.cloth_contact import ContactSettings
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.mesh import TriangleMesh, disk
from yarnscale.shell.scenes.scene import Scene, SceneResult
from yarnscale.shell.scenes.thickness import cloth_thickness
from yarnscale.shell.state import ClothState

SPECIMEN, DISC = 0.15, 0.09
"""Radii of specimen and disc [m]."""
SPACING = 0.0075
_ANGLES = 360
_FOLD = 0.03
"""A fold stands out by at least this share of the specimen's free width."""


@dataclass(frozen=True, eq=False)
class DrapeTest:
    """Outcome. coefficient: shadow of the free ring over the ring itself, 0 to 1 (Cusick's, times 100 in per cent).

    folds: waves of the shadow's outline. outline: its radius [m] at every degree from the course, (360,). Coefficient
    and folds count only where ``succeeded``: the cloth came to rest and crosses itself nowhere.
    """

    coefficient: float
    folds: int
    outline: Array
    result: SceneResult

    @property
    def succeeded(self) -> bool:
        """Whether the cloth came to rest without crossing itself."""
        return self.result.succeeded

    @property
    def status(self) -> str:
        """How the simulation ended."""
        if self.result.converged and not self.succeeded:
            return "crossed"
        return "" if (status := self.result.run.status) is None else status.name.lower()


def cusick(material: ShellMaterial, *, spacing: float = SPACING, seed: int = 0) -> Scene:
    """The scene: clamped between discs of 18 cm, the free ring falls and comes to rest, in contact with itself.

    seed: of the unevenness from which folds grow, in the mesh and in the height of its vertices (0.1 mm); other seeds
    may give other folds.
    """
    mesh, random = _uneven(disk(SPECIMEN, spacing), spacing, seed), np.random.default_rng(seed)
    start = ClothState.flat(mesh)
    away = np.linalg.norm(mesh.panel, axis=1)
    held = np.flatnonzero(away <= DISC + 1e-9)
    noise = random.normal(scale=1e-4, size=len(away)) * (away > DISC)
    start = replace(start, positions=start.positions + noise[:, None] * [0.0, 0.0, 1.0])
    clamp = Handle("discs", held, start.positions[held])
    contact = ContactSettings(cloth_thickness(material, mesh), friction=0.3)
    cloth = Cloth(mesh, material, (clamp,), contact=contact, damping=4.0)
    schedule = Schedule(0.6, 1 / 60, to_rest=True, rough_iterations=30)

    def measure(solver: ClothSolver, state: ClothState) -> dict[str, float]:
        shadow = outline(state.positions, mesh.edges)
        return {"drape_coefficient": drape_coefficient(shadow), "folds": float(folds(shadow))}

    return Scene("cusick", cloth, start, schedule, measure=measure)


def _uneven(mesh: TriangleMesh, spacing: float, seed: int) -> TriangleMesh:
    """The disk with its inner vertices moved about and turned, so that its six sectors do not choose the folds."""
    random = np.random.default_rng(seed)
    points = np.asarray(mesh.panel)
    away = np.linalg.norm(points, axis=1)
    free = (away < SPECIMEN - 0.5 * spacing) & (np.abs(away - DISC) > 0.5 * spacing)
    points = points + 0.25 * spacing * random.uniform(-1, 1, points.shape) * free[:, None]
    c, s = math.cos(turn := random.uniform(0, math.pi / 3)), math.sin(turn)
    return TriangleMesh(points @ np.array([[c, s], [-s, c]]), mesh.triangles)


def drape_test(material: ShellMaterial, *, spacing: float = SPACING, seed: int = 0) -> DrapeTest:
    """Drape a shell material and measure its shadow."""
    result = run_scene(cusick(material, spacing=spacing, seed=seed))
    shadow = outline(result.state.positions, result.scene.cloth.mesh.edges)
    return DrapeTest(drape_coefficient(shadow), folds(shadow), shadow, result)


def outline(positions: Array, edges: Integers) -> Array:
    """Radius [m] of the shadow from above at every degree, (360,): the farthest point of any edge there.

    The shadow is taken to be star-shaped about the origin, as it is where cloth hangs from a disc.
    """
    share = np.linspace(0.0, 1.0, 33)[:, None, None]
    points = ((1 - share) * positions[edges[:, 0], :2] + share * positions[edges[:, 1], :2]).reshape(-1, 2)
    place = np.floor(np.degrees(np.arctan2(points[:, 1], points[:, 0])) % 360.0).astype(int) % _ANGLES
    radius = np.full(_ANGLES, 0.0)
    np.maximum.at(radius, place, np.linalg.norm(points, axis=1))
    return radius


def drape_coefficient(shadow: Array) -> float:
    """(shadow − disc)/(specimen − disc), areas."""
    area = 0.5 * float((shadow**2).mean()) * 2 * math.pi
    return (area - math.pi * DISC**2) / (math.pi * (SPECIMEN**2 - DISC**2))


def folds(shadow: Array) -> int:
    """Number of waves of an outline, smoothed over nine degrees."""
    kernel = np.ones(9) / 9
    smooth = np.convolve(np.concatenate([shadow[-4:], shadow, shadow[:4]]), kernel, mode="valid")
    start = int(smooth.argmin())
    around = np.concatenate([smooth[start:], smooth[: start + 1]])
    return len(find_peaks(around, prominence=_FOLD * (SPECIMEN - DISC))[0])

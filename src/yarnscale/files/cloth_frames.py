"""Frames of a cloth as files, each written whole as soon as it is finished."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError, system_errors
from yarnscale.files.array_file import checked_array, checked_indices, read_arrays, write_arrays
from yarnscale.files.body_surface import BodySurface
from yarnscale.motion.obstacles import Obstacle
from yarnscale.shell.mesh import TriangleMesh
from yarnscale.shell.state import ClothState

MESH = "mesh.npz"
BODIES = "bodies.npz"


class FrameWriter:
    """A folder with ``frame_0000.npz``, ``frame_0001.npz``, …, each replaced in one step.

    Where there are obstacles with a surface, ``bodies.npz`` has their triangles and every frame their vertices as
    ``bodies`` (nb, 3) [m], in their actual places, also if they missed their prescribed ones. keep: frames
    of an earlier run, from the first on, that stay; all others are removed at the start. Raises InputError where the
    folder cannot be written.
    """

    def __init__(self, folder: str | os.PathLike[str], *, obstacles: Sequence[Obstacle] = (), keep: int = 0) -> None:
        self.folder = Path(folder)
        self._bodies = BodySurface(obstacles)
        with system_errors(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
            for number, path in frame_paths(self.folder).items():
                if number >= keep:
                    path.unlink()
            if not self._bodies:
                (self.folder / BODIES).unlink(missing_ok=True)
        if self._bodies:
            write_arrays(self.folder / BODIES, triangles=self._bodies.triangles)

    def write_arrays(self, number: int, time: float, moved: Array | None = None, **arrays: ArrayLike) -> None:
        """One frame at a time [s]; moved: where the points of moving obstacles are, as in ``ClothState``."""
        if self._bodies:
            arrays["bodies"] = self._bodies.vertices(time, moved)
        write_arrays(self.folder / frame_name(number), time=np.array(float(time)), **arrays)


class FrameFolder(FrameWriter):
    """Frames of a cloth, and ``mesh.npz``: material points (nm, 2) [m], triangles (nt, 3), corners (nt, 3) among them.

    A frame has positions [m], velocities [m/s], both (nv, 3), and time [s]. Pass ``write`` as ``on_frame``.
    """

    def __init__(
        self, folder: str | os.PathLike[str], mesh: TriangleMesh, *, obstacles: Sequence[Obstacle] = (), keep: int = 0
    ) -> None:
        super().__init__(folder, obstacles=obstacles, keep=keep)
        write_arrays(self.folder / MESH, material=mesh.material, triangles=mesh.triangles, corners=mesh.corners)

    def write(self, number: int, state: ClothState) -> None:
        """Write one frame."""
        self.write_arrays(number, state.time, state.obstacles, positions=state.positions, velocities=state.velocities)


def frame_name(number: int) -> str:
    """File name of a frame."""
    return f"frame_{number:04d}.npz"


def frame_paths(folder: Path) -> dict[int, Path]:
    """Frames in a folder by number, in order."""
    found = {}
    for path in folder.glob("frame_*.npz"):
        if match := re.fullmatch(r"frame_(\d{4,})\.npz", path.name):
            found[int(match[1])] = path
    return dict(sorted(found.items()))


def read_frame(path: str | os.PathLike[str]) -> ClothState:
    """A state written by ``FrameFolder``; InputError where the file is none."""
    arrays = read_arrays(path, "positions", "velocities", "time", what="frame of a cloth")
    positions = checked_array(arrays["positions"], name="positions", shape=(None, 3), where=path)
    velocities = checked_array(arrays["velocities"], name="velocities", shape=positions.shape, where=path)
    return ClothState(positions, velocities, float(checked_array(arrays["time"], name="time", shape=(), where=path)))


@dataclass(frozen=True, eq=False)
class Frames:
    """Files of frames: paths by number, times of each [s], (nf,), and triangles of the bodies (mb, 3) or None."""

    paths: dict[int, Path]
    times: Array
    body_triangles: Integers | None

    def bodies(self, number: int) -> Array | None:
        """Vertices of the bodies in a frame [m], (nb, 3), or None without any."""
        if self.body_triangles is None:
            return None
        path = self.paths[number]
        vertices = read_arrays(path, "bodies", what="frame with bodies")["bodies"]
        vertices = checked_array(vertices, name="bodies", shape=(None, 3), where=path)
        if len(vertices) <= self.body_triangles.max(initial=-1):
            raise InputError("bodies", where=path, expected="vertices of all triangles", found=vertices.shape)
        return vertices


@dataclass(frozen=True, eq=False)
class ClothFrames(Frames):
    """Frames of a cloth to read.

    triangles: vertices in space, corners: material points of each triangle, both (nt, 3); material: the points
    (nm, 2) [m].
    """

    triangles: Integers
    corners: Integers
    material: Array

    def among(self, numbers: Sequence[int]) -> ClothFrames:
        """The frames of these numbers alone."""
        index = [k for k, number in enumerate(self.paths) if number in set(numbers)]
        return replace(self, paths={n: self.paths[n] for n in numbers}, times=self.times[index])

    def state(self, number: int) -> ClothState:
        """Frame of a number; InputError where it does not belong to the mesh."""
        state, count = read_frame(self.paths[number]), int(self.triangles.max(initial=-1)) + 1
        if len(state.positions) != count:
            found = state.positions.shape
            raise InputError("positions", where=self.paths[number], expected=f"shape ({count}, 3)", found=found)
        return state


def read_cloth_frames(folder: str | os.PathLike[str]) -> ClothFrames:
    """The frames of a folder, or of ``frames`` within it, each read on first use.

    Raises InputError where the folder, the mesh or frames are missing or damaged.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError("folder does not exist", where=folder, expected="frames of a cloth")
    if not (folder / MESH).is_file() and (folder / "frames").is_dir():
        folder = folder / "frames"
    arrays = read_arrays(folder / MESH, "material", "triangles", optional=("corners",), what="mesh of a cloth")
    material = checked_array(arrays["material"], name="material", shape=(None, 2), where=folder / MESH)
    triangles, corners = (
        checked_indices(arrays.get(name, arrays["triangles"]), name=name, width=3, count=len(material),
                        where=folder / MESH)
        for name in ("triangles", "corners")
    )  # fmt: skip
    if len(corners) != len(triangles):
        raise InputError("corners", where=folder / MESH, expected=f"{len(triangles)} rows", found=len(corners))
    return ClothFrames(*frame_files(folder), triangles, corners, material)


def frame_files(folder: Path) -> tuple[dict[int, Path], Array, Integers | None]:
    """The fields of ``Frames`` of a folder; InputError where there are none."""
    paths, bodies = frame_paths(folder), None
    if (folder / BODIES).is_file():
        stored = read_arrays(folder / BODIES, "triangles", what="bodies in frames")["triangles"]
        bodies = checked_indices(stored, name="triangles", width=3, count=np.iinfo(np.int64).max, where=folder / BODIES)
    return paths, frame_times(folder, paths), bodies


def frame_times(folder: Path, paths: dict[int, Path]) -> Array:
    """Times of frames [s], (nf,); InputError where there are none."""
    if not paths:
        raise InputError("folder holds no frames", where=folder, expected="frame_0000.npz and so on")
    times = [read_arrays(path, "time", what="frame")["time"] for path in paths.values()]
    return np.array([float(checked_array(t, name="time", shape=(), where=folder)) for t in times])

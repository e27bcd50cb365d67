"""What all animated formats are written from: cloth, yarns and bodies at a list of times."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError
from yarnscale.files.cloth_frames import MESH, ClothFrames, read_cloth_frames
from yarnscale.files.curve_frames import CURVES, CurveFrames, CurveSet, read_curve_frames


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles (nt, 3) whose vertices move.

    material: points in the fabric (nm, 2) [m], or None; corners: those of each triangle (nt, 3).
    """

    triangles: Integers
    material: Array | None = None
    corners: Integers | None = None

    @property
    def sewn(self) -> bool:
        """Whether vertices have several material points."""
        return self.corners is not None and not np.array_equal(self.corners, self.triangles)


@dataclass(frozen=True, eq=False)
class Moment:
    """One frame: time [s]; positions of cloth, yarns and bodies (n, 3) [m], None where there are none.

    velocities: of the cloth [m/s]. radii: of the yarn's points [m], (n,).
    """

    time: float
    cloth: Array | None = None
    velocities: Array | None = None
    yarns: Array | None = None
    radii: Array | None = None
    bodies: Array | None = None


@dataclass(frozen=True, eq=False)
class Animation:
    """Moving cloth, yarns and bodies, frames read one by one: they are never in memory together.

    times: of the frames, strictly increasing [s], (nf,). moment: the frame of an index below nf. numbers: that the
    frames bear in their folder, default 0, 1, 2, …
    """

    times: Array
    moment: Callable[[int], Moment]
    cloth: Surface | None = None
    yarns: CurveSet | None = None
    bodies: Surface | None = None
    numbers: Sequence[int] = ()

    def __post_init__(self) -> None:
        if not self.numbers:
            object.__setattr__(self, "numbers", range(len(self.times)))

    def __len__(self) -> int:
        return len(self.times)

    def __iter__(self) -> Iterator[Moment]:
        return (self.moment(k) for k in range(len(self)))

    def among(self, numbers: Sequence[int]) -> Animation:
        """The frames of these numbers alone."""
        index = [k for k, number in enumerate(self.numbers) if number in set(numbers)]
        return replace(self, times=self.times[index], moment=lambda k: self.moment(index[k]), numbers=list(numbers))


def read_animation(folder: str | os.PathLike[str], *, yarns: str | os.PathLike[str] | None = None) -> Animation:
    """The frames of a run.

    folder: frames of a cloth, frames of curves, or what ``simulate`` writes, with ``frames`` and perhaps ``yarns``
    inside. yarns: a folder of curve frames to go with the cloth. Where both are there, frames that only one of them
    has are left out. Raises InputError where a folder is missing or damaged.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError("folder does not exist", where=folder, expected="frames of a run")
    cloth_folder = next((place for place in (folder, folder / "frames") if (place / MESH).is_file()), None)
    curve_folder = next((place for place in (folder, folder / "yarns") if (place / CURVES).is_file()), None)
    if yarns is not None:
        curve_folder = Path(yarns)
    if cloth_folder is None and curve_folder is None:
        raise InputError(
            "folder holds no frames", where=folder, expected=f"{MESH} or {CURVES}, or a folder 'frames' with it"
        )
    cloth = read_cloth_frames(cloth_folder) if cloth_folder is not None else None
    curves = read_curve_frames(curve_folder) if curve_folder is not None else None
    return _joined(folder, cloth, curves)


def _joined(folder: Path, cloth: ClothFrames | None, curves: CurveFrames | None) -> Animation:
    sources = [part for part in (cloth, curves) if part is not None]
    numbers = [n for n in sources[0].paths if all(n in part.paths for part in sources)]
    if not numbers:
        found = " and ".join(f"{min(part.paths)}..{max(part.paths)}" for part in sources)
        raise InputError("cloth and yarns share no frame", where=folder, expected="the same numbers", found=found)
    time_of = dict(zip(sources[0].paths, sources[0].times, strict=True))
    times = np.array([time_of[n] for n in numbers])
    late = np.flatnonzero(np.diff(times) <= 0)
    if len(late):
        k, found = int(late[0]), f"{times[late[0] + 1]:g} s"
        expected = f"later than {times[k]:g} s"
        raise InputError(f"time of frame {numbers[k + 1]}", where=folder, expected=expected, found=found)

    def moment(index: int) -> Moment:
        number, positions, velocities = numbers[index], None, None
        if cloth is not None:
            state = cloth.state(number)
            positions, velocities = state.positions, state.velocities
        points, radii = (None, None) if curves is None else curves.points(number)
        return Moment(float(times[index]), positions, velocities, points, radii, sources[0].bodies(number))

    surface = None if cloth is None else Surface(cloth.triangles, cloth.material, cloth.corners)
    bodies = None if sources[0].body_triangles is None else Surface(sources[0].body_triangles)
    return Animation(times, moment, surface, None if curves is None else curves.curves, bodies, numbers)


def vertex_normals(positions: Array, triangles: Integers) -> Array:
    """Unit normals of a surface's vertices, weighted by area, (nv, 3); +z where a vertex has none."""
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    faces = np.cross(b - a, c - a)
    corners = triangles.ravel()
    sums = np.stack([np.bincount(corners, np.repeat(faces[:, k], 3), len(positions)) for k in range(3)], axis=1)
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.where(lengths > 0, sums / np.where(lengths > 0, lengths, 1.0), [0.0, 0.0, 1.0])

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
    cloth_folder, curve_folder = _parts(folder)
    if yarns is not None:
        curve_folder = Path(yarns)
    if cloth_folder is None and curve_folder is None:
        raise InputError(
            "folder holds no frames", where=folder, expected=f"{MESH} or {CURVES}, or a folder 'frames' with it"
        )
    cloth = read_cloth_frames(cloth_folder) if cloth_folder is not None else None
    curves = read_curve_frames(curve_folder) if curve_folder is not None else None
    return _joined(folder, cloth, curves)


def _parts(folder: Path) -> tuple[Path | None, Path | None]:
    """Where the frames of cloth and of curves are, None where they are not."""
    cloth = next((f for f in (folder, folder / "frames") if (f / MESH).is_file()), None)
    curves = next((f for f in (folder, folder / "yarns") if (f / CURVES).is_file()), None)
    return cloth, curves


def _joined(folder: Path, cloth: ClothFrames | None, curves: CurveFrames | None) -> Animation:
    sources = [part for part in (cloth, curves) if part is not None]
    numbers = [n for n in sources[0].paths if all(n in part.paths for part in sources)]
    if not numbers:
        raise InputError(
            "cloth and yarns share no frame",
            where=folder,
            expected="frames of the same numbers",
            found=" and ".join(f"{min(p.paths)}..{max(p.paths)}" for p in sources),
        )
    time_of = dict(zip(sources[0].paths, sources[0].times, strict=True))
    times = np.array([time_of[n] for n in numbers])
    late = np.flatnonzero(np.diff(times) <= 0)
    if len(late):
        k = int(late[0])
        raise InputError(
            f"time of frame {numbers[k + 1]}",
            where=folder,
            expected=f"later than {times[k]:g} s",
            found=f"{times[k + 1]:g} s",
        )

    def moment(index: int) -> Moment:
        number = numbers[index]
        state = cloth.state(number) if cloth is not None else None
        points, radii = curves.points(number) if curves is not None else (None, None)
        return Moment(
            float(times[index]),
            state.positions if state is not None else None,
            state.velocities if state is not None else None,
            points,
            radii,
            sources[0].bodies(number),
        )

    bodies = sources[0].body_triangles
    return Animation(
        times,
        moment,
        Surface(cloth.triangles, cloth.material, cloth.corners) if cloth is not None else None,
        curves.curves if curves is not None else None,
        Surface(bodies) if bodies is not None else None,
        numbers,
    )


def vertex_normals(positions: Array, triangles: Integers) -> Array:
    """Unit normals of a surface's vertices, weighted by area, (nv, 3); +z where a vertex has none."""
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    faces = np.cross(b - a, c - a)
    corners = triangles.ravel()
    sums = np.stack([np.bincount(corners, np.repeat(faces[:, k], 3), len(positions)) for k in range(3)], axis=1)
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.where(lengths > 0, sums / np.where(lengths > 0, lengths, 1.0), [0.0, 0.0, 1.0])

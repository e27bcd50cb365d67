"""Frames of yarn curves as files: what stays in ``curves.npz``, what moves in one file a frame."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.errors import InputError, located
from yarnscale.files.array_file import checked_array, read_arrays, write_arrays
from yarnscale.files.cloth_frames import Frames, FrameWriter, frame_files
from yarnscale.motion.obstacles import Obstacle

CURVES = "curves.npz"


@dataclass(frozen=True, eq=False)
class CurveSet:
    """Which points make up which curve, and how thick it is; smooth curves pass through their points.

    offsets: curve i owns the points offsets[i] … offsets[i + 1] − 1, (nc + 1,). radii: of every point [m], (n,);
    one number or one per curve (nc,) serves too. closed: whether the last point joins the first, (nc,), default
    False. yarn: a number that picks the colour, (nc,), default 0, 1, 2, …

    Raises InputError; an open curve has two points or more, a closed one three.
    """

    offsets: Integers
    radii: Array
    closed: Flags
    yarn: Integers

    def __init__(
        self, offsets: ArrayLike, radii: ArrayLike, *, closed: ArrayLike | None = None, yarn: ArrayLike | None = None
    ) -> None:
        starts = np.asarray(offsets)
        if starts.ndim != 1 or len(starts) < 2 or starts.dtype.kind not in "iu" or starts[0] != 0:
            raise InputError("offsets", expected="integers from 0, shape (nc + 1,)", found=starts.shape)
        starts = starts.astype(np.int64)
        count = len(starts) - 1
        loops = np.zeros(count, bool) if closed is None else np.asarray(closed)
        numbers = np.arange(count) if yarn is None else np.asarray(yarn)
        for name, array, kinds in (("closed", loops, "b"), ("yarn", numbers, "iu")):
            if array.shape != (count,) or array.dtype.kind not in kinds:
                raise InputError(name, expected=f"shape ({count},)", found=f"{array.shape}, {array.dtype}")
        short = np.diff(starts) < np.where(loops, 3, 2)
        if short.any():
            worst = int(np.flatnonzero(short)[0])
            expected = "three points" if loops[worst] else "two points"
            raise InputError(f"curve {worst}", expected=expected, found=int(np.diff(starts)[worst]))
        vars(self).update(offsets=starts, closed=loops, yarn=numbers.astype(np.int64))
        vars(self)["radii"] = self._per_point(np.asarray(radii))

    def _per_point(self, radii: NDArray) -> Array:
        if radii.ndim == 0:
            radii = np.full(self.point_count, radii)
        elif radii.shape == (len(self),) and len(self) != self.point_count:
            radii = np.repeat(radii, np.diff(self.offsets))
        radii = checked_array(radii, name="radii", shape=(self.point_count,))
        if (radii <= 0).any():
            raise InputError("radii", expected="positive lengths [m]", found=float(radii.min()))
        return radii

    @property
    def point_count(self) -> int:
        """Number of points of all curves."""
        return int(self.offsets[-1])

    def __len__(self) -> int:
        return len(self.closed)

    def chosen(self, which: Flags) -> tuple[CurveSet, Integers]:
        """The curves marked in ``which`` (nc,), and the points they take from these (m,)."""
        lengths = np.diff(self.offsets)
        points = np.flatnonzero(np.repeat(which, lengths))
        offsets = np.concatenate([[0], np.cumsum(lengths[which])])
        part = CurveSet(offsets, self.radii[points], closed=self.closed[which], yarn=self.yarn[which])
        return part, points

    def segments(self) -> Integers:
        """Pairs of points that follow each other, (m, 2), the closing ones of loops included."""
        first = np.arange(self.point_count)
        second = first + 1
        ends = self.offsets[1:] - 1
        second[ends] = self.offsets[:-1]
        keep = np.ones(self.point_count, bool)
        keep[ends[~self.closed]] = False
        return np.stack([first, second], axis=1)[keep]


class CurveFolder(FrameWriter):
    """Frames of curves, and ``curves.npz``, the fields of a ``CurveSet``.

    A frame has positions (n, 3) [m] of all points and time [s]; radii (n,) [m] too where they change. Frames
    bear the numbers of the cloth's frames they belong to.
    """

    def __init__(
        self, folder: str | os.PathLike[str], curves: CurveSet, *, obstacles: Sequence[Obstacle] = (), keep: int = 0
    ) -> None:
        super().__init__(folder, obstacles=obstacles, keep=keep)
        self.curves = curves
        write_arrays(
            self.folder / CURVES, offsets=curves.offsets, radii=curves.radii, closed=curves.closed, yarn=curves.yarn
        )

    def write(self, number: int, positions: Array, time: float, *, radii: Array | None = None) -> None:
        """Write one frame."""
        count = self.curves.point_count
        arrays = {"positions": checked_array(np.asarray(positions), name="positions", shape=(count, 3))}
        if radii is not None:
            arrays["radii"] = checked_array(np.asarray(radii), name="radii", shape=(count,))
        self.write_arrays(number, time, **arrays)


@dataclass(frozen=True, eq=False)
class CurveFrames(Frames):
    """Frames of curves to read, and the ``curves``."""

    curves: CurveSet

    def points(self, number: int) -> tuple[Array, Array]:
        """Positions (n, 3) and radii (n,) of a frame [m]; InputError where it is none of these curves."""
        path, count = self.paths[number], self.curves.point_count
        arrays = read_arrays(path, "positions", optional=("radii",), what="frame of curves")
        positions = checked_array(arrays["positions"], name="positions", shape=(count, 3), where=path)
        if "radii" not in arrays:
            return positions, self.curves.radii
        return positions, checked_array(arrays["radii"], name="radii", shape=(count,), where=path)


def read_curve_frames(folder: str | os.PathLike[str]) -> CurveFrames:
    """The curve frames of a folder, each read on first use; InputError where something is missing."""
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError("folder does not exist", where=folder, expected="frames of curves")
    path = folder / CURVES
    arrays = read_arrays(path, "offsets", "radii", optional=("closed", "yarn"), what="set of curves")
    with located(path):
        curves = CurveSet(arrays["offsets"], arrays["radii"], closed=arrays.get("closed"), yarn=arrays.get("yarn"))
    return CurveFrames(*frame_files(folder), curves)

"""Frames of a cloth as files, each written whole as soon as it is finished."""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.files.atomic import write_bytes
from yarnscale.shell.mesh import TriangleMesh
from yarnscale.shell.state import ClothState


class FrameFolder:
    """A folder with ``mesh.npz`` (material (nv, 2), triangles (nt, 3)) and ``frame_0000.npz``, ``frame_0001.npz``, …

    A frame holds positions [m], velocities [m/s], both (nv, 3), and time [s]. Pass ``write`` as ``on_frame``. Frames
    of an earlier run are removed at the start. Raises InputError where the folder cannot be written.
    """

    def __init__(self, folder: str | os.PathLike[str], mesh: TriangleMesh) -> None:
        self.folder = Path(folder)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            for old in self.folder.glob("frame_[0-9]*.npz"):
                old.unlink()
        except OSError as error:
            reason = error.strerror or str(error)
            raise InputError("output cannot be written", where=self.folder, found=reason) from None
        _write(self.folder / "mesh.npz", material=mesh.material, triangles=mesh.triangles)

    def write(self, number: int, state: ClothState) -> None:
        """Write one frame; a file of that number is replaced in one step."""
        _write(
            self.folder / f"frame_{number:04d}.npz",
            positions=state.positions,
            velocities=state.velocities,
            time=np.array(state.time),
        )


def read_frame(path: str | os.PathLike[str]) -> ClothState:
    """A state written by ``FrameFolder``; InputError where the file is none."""
    try:
        with np.load(path, allow_pickle=False) as file:
            positions, velocities = np.asarray(file["positions"]), np.asarray(file["velocities"])
            time = float(file["time"])
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise InputError("file is no frame of a cloth", where=path, found=str(error)[:80]) from None
    if positions.ndim != 2 or positions.shape[1:] != (3,) or velocities.shape != positions.shape:
        raise InputError("positions", where=path, expected="shape (n, 3)", found=positions.shape)
    return ClothState(positions.astype(float), velocities.astype(float), time)


def _write(path: Path, **arrays: NDArray) -> None:
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    write_bytes(path, buffer.getvalue())

"""Named arrays in one .npz file, written whole and read with errors that say what is wrong."""

from __future__ import annotations

import io
import os
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import ArrayLike, NDArray

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError
from yarnscale.files.atomic import write_bytes

_UNPACKED, _LARGEST_RATIO = 100_000_000, 30
"""Largest size of arrays [bytes], and how many times that of their file is added to it."""


def write_arrays(path: str | os.PathLike[str], **arrays: ArrayLike) -> None:
    """Replace a file by these arrays in one step; InputError where it cannot be written."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **{name: np.asarray(value) for name, value in arrays.items()})
    write_bytes(path, buffer.getvalue())


def read_arrays(
    path: str | os.PathLike[str], *required: str, optional: Sequence[str] = (), what: str
) -> dict[str, NDArray]:
    """The arrays of these names; of the optional ones those that are there.

    what: the kind of file, for the errors. Raises InputError where the file is missing or none of that kind.
    """
    with _opened(path, what) as file:
        present = [name for name in optional if name in file.files]
        return {name: np.asarray(file[name]) for name in (*required, *present)}


def read_names(path: str | os.PathLike[str], *, what: str) -> list[str]:
    """Names of the arrays in a file; errors as in ``read_arrays``."""
    with _opened(path, what) as file:
        return list(file.files)


@contextmanager
def _opened(path: str | os.PathLike[str], what: str) -> Iterator[NpzFile]:
    if not Path(path).is_file():
        raise InputError("file does not exist", where=path, expected=what)
    try:
        with np.load(path, allow_pickle=False) as file:
            if not isinstance(file, NpzFile):
                raise ValueError("a single array")
            size = sum(entry.file_size for entry in file.zip.infolist())  # type: ignore[union-attr]
            if size > _UNPACKED + _LARGEST_RATIO * Path(path).stat().st_size:
                raise ValueError(f"{size / 1e9:.1f} GB once unpacked")
            yield file
    except (OSError, ValueError, KeyError, EOFError, MemoryError, zipfile.BadZipFile, zlib.error) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"file is no {what}", where=path, found=str(error)[:80]) from None


def checked_array(array: NDArray, *, name: str, shape: tuple[int | None, ...], where: object = None) -> Array:
    """The array as finite numbers of a shape (None: any length); InputError otherwise."""
    fits = array.ndim == len(shape) and all(
        want is None or want == got for want, got in zip(shape, array.shape, strict=True)
    )
    if not fits:
        wanted = "(" + ", ".join("n" if n is None else str(n) for n in shape) + ")"
        raise InputError(name, where=where, expected=f"shape {wanted}", found=array.shape)
    if array.dtype.kind not in "iuf" or not np.isfinite(array).all():
        raise InputError(name, where=where, expected="finite numbers", found=f"others ({array.dtype})")
    return array.astype(float)


def checked_indices(array: NDArray, *, name: str, width: int, count: int, where: object = None) -> Integers:
    """The array as indices below ``count``, shape (n, width); InputError otherwise."""
    if array.ndim != 2 or array.shape[1] != width or array.dtype.kind not in "iu":
        raise InputError(name, where=where, expected=f"integers of shape (n, {width})", found=array.shape)
    if array.size and (array.min() < 0 or array.max() >= count):
        raise InputError(name, where=where, expected=f"indices 0..{count - 1}", found=f"{array.min()}..{array.max()}")
    return array.astype(np.int64)

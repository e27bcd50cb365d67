"""Write a file whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from yarnscale.errors import InputError


@contextmanager
def replacement(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A new empty file to fill, which takes the place of `path` in one step at the end.

    It lies in the same folder and has the same suffix. On any error the old file, if any, stays untouched. Raises
    InputError where the target cannot be written.
    """
    if os.path.isdir(path):
        raise InputError("output is a folder", where=path, expected="the path of a file")
    # A link keeps pointing where it did: the file behind it is replaced.
    target = Path(os.path.realpath(path))
    temporary: str | None = None
    try:
        handle, temporary = tempfile.mkstemp(
            prefix=f".{target.name[:80]}.", suffix=f".part{target.suffix[:20]}", dir=target.parent
        )
        os.close(handle)
        yield Path(temporary)
        os.chmod(temporary, _permissions(target))
        os.replace(temporary, target)
        temporary = None
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise InputError("output cannot be written", where=path, found=reason) from None
    finally:
        if temporary is not None and os.path.exists(temporary):
            os.unlink(temporary)


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """Replace `path` by `content` in one step; see `replacement`."""
    with replacement(path) as temporary, open(temporary, "wb") as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())


def write_text(path: str | os.PathLike[str], content: str) -> None:
    """Replace `path` by UTF-8 text in one step; see `write_bytes`."""
    write_bytes(path, content.encode("utf-8"))


def _permissions(target: Path) -> int:
    """Mode of the file that is replaced, or that of a new file."""
    try:
        return target.stat().st_mode & 0o777
    except OSError:
        mask = os.umask(0)
        os.umask(mask)
        return 0o666 & ~mask

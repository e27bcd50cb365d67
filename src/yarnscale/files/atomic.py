"""Write a file whole or not at all."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from yarnscale.errors import InputError, system_errors


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
        with system_errors(path):
            handle, temporary = tempfile.mkstemp(
                prefix=f".{target.name[:80]}.", suffix=f".part{target.suffix[:20]}", dir=target.parent
            )
            os.close(handle)
            yield Path(temporary)
            os.chmod(temporary, _permissions(target))
            os.replace(temporary, target)
            temporary = None
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


def write_json(path: str | os.PathLike[str], content: Mapping[str, object]) -> None:
    """Replace `path` by ``json_rows`` in one step; InputError for values that JSON does not have."""
    try:
        text = json_rows(content) + "\n"
    except (TypeError, ValueError) as error:
        raise InputError(
            "content", where=path, expected="plain JSON values, in the provenance too", found=error
        ) from None
    write_text(path, text)


def json_rows(value: object, indent: str = "") -> str:
    """JSON with one row of numbers a line, so that a file can be read and compared by eye."""
    inner = indent + "  "
    if isinstance(value, Mapping) and value:
        rows = [f"{inner}{json.dumps(str(key))}: {json_rows(item, inner)}" for key, item in value.items()]
        return "{\n" + ",\n".join(rows) + f"\n{indent}}}"
    if isinstance(value, (list, tuple)) and any(isinstance(item, (list, tuple, Mapping)) for item in value):
        return "[\n" + ",\n".join(inner + json_rows(item, inner) for item in value) + f"\n{indent}]"
    return json.dumps(value, allow_nan=False, ensure_ascii=False)


def _permissions(target: Path) -> int:
    """Mode of the file that is replaced, or that of a new file."""
    try:
        return target.stat().st_mode & 0o777
    except OSError:
        mask = os.umask(0)
        os.umask(mask)
        return 0o666 & ~mask

"""Compiled object code on disk, in a folder that only the user can write.

An entry holds the digest of its key and of its content. One that does not match, or that somebody else could have
written, is rebuilt and never run.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import stat
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

_MAGIC = b"yarnscale-object-1\n"


def folder() -> Path:
    """Where object code is kept: ``$YARNSCALE_CACHE``, or the user's cache folder."""
    chosen = os.environ.get("YARNSCALE_CACHE")
    if chosen:
        return Path(chosen)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", str(Path.home()))) / "yarnscale" / "cache"
    return Path(os.environ.get("XDG_CACHE_HOME", str(Path.home() / ".cache"))) / "yarnscale"


def _private(path: Path) -> bool:
    """Whether only this user can write ``path`` (not a link, own, no group or world write permission)."""
    try:
        status = os.lstat(path)
    except OSError:
        return False
    if stat.S_ISLNK(status.st_mode):
        return False
    if not hasattr(os, "getuid"):
        return True
    return status.st_uid == os.getuid() and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _prepared() -> Path | None:
    """The cache folder, created private; None where it cannot be trusted or written."""
    path = folder()
    with contextlib.suppress(OSError):
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
    return path if _private(path) else None


def _header(key_digest: bytes, code: bytes) -> bytes:
    return _MAGIC + key_digest + hashlib.sha256(code).digest()


def fetch(key: str, build: Callable[[], bytes]) -> bytes:
    """Object code for ``key``: from the folder where a matching entry lies, else from ``build()``, which is stored."""
    digest = hashlib.sha256(key.encode()).digest()
    root = _prepared()
    if root is None:
        return build()
    path = root / f"{digest.hex()[:40]}.o"
    if path.exists() and _private(path):
        with contextlib.suppress(OSError):
            content = path.read_bytes()
            size = len(_MAGIC) + 64
            if len(content) > size and content[:size] == _header(digest, content[size:]):
                return content[size:]
    code = build()
    with contextlib.suppress(OSError):
        _store(path, _header(digest, code) + code)
    return code


def _store(path: Path, content: bytes) -> None:
    """Write whole or not at all, so that processes which compile at once cannot spoil each other's entry."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=".building-")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
        os.replace(name, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(name)
        raise

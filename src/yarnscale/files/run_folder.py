"""Folders that a command owns: results of an earlier run go as a whole or stay, and files of others are never touched.

A record beside the results, ``.yarnscale.json``, lists what the command makes: names with ``*``, and folders with a
slash at the end. It is written before the first result, so that runs that were killed have it too.
"""

from __future__ import annotations

import glob
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath

from yarnscale.errors import InputError, system_errors
from yarnscale.files.atomic import write_text

RECORD = ".yarnscale.json"
PAGE = ("last.obj", "last.png", "frames.png", "index.html")
"""Page and pictures of every simulation (``show.run_page``)."""


class RunFolder:
    """The folder for the results of one run of a command; a context that yields its path.

    makes: what the run will write, as names relative to the folder. goes_on_from: those that a resumed run needs.
    valued: those that only ``overwrite`` or ``resume`` may touch, by default all.
    When it is made, nothing is changed; InputError where the folder holds valued results and neither ``overwrite`` nor
    ``resume`` is asked for, results of another command, or, without ``overwrite``, files of these names that no record
    lists. On entry all this is tested again, the folder is created, and results of an earlier run are removed; of a
    resumed one at the end, if it added to what it went on from, and only those that it neither wrote nor needed.
    Other files in the folder stay.
    """

    def __init__(
        self,
        path: Path,
        command: str,
        makes: Sequence[str],
        *,
        overwrite: bool = False,
        resume: bool = False,
        goes_on_from: Sequence[str] = (),
        valued: Sequence[str] | None = None,
    ) -> None:
        self.path, self._command, self._makes, self._needs = path, command, makes, goes_on_from
        self._overwrite, self._resume, self._valued = overwrite, resume, valued
        self._old: dict[Path, int] = {}
        self._began_with: set[Path] = set()
        self._check()

    def __enter__(self) -> Path:
        made = self._check()
        writable_folder(self.path)
        there = [*_matching(self.path, [*made, *self._makes])]
        needed = {*_matching(self.path, self._needs)}
        resumed = self._resume and bool(needed)
        if resumed:
            self._old = {path: path.stat().st_mtime_ns for path in there if not needed & {path, *path.parents}}
            self._began_with = self._gone_on_from()
        else:
            _remove(self.path, there)
        _write(self.path, self._command, [*made, *self._makes] if resumed else self._makes)
        return self.path

    def _check(self) -> list[str]:
        """What the record lists; InputError where the run must not begin."""
        check_place(self.path)
        made = _made(self.path, self._command)
        if self._overwrite:
            return made
        valued = [*made, *self._makes] if self._valued is None else self._valued
        there = next(_matching(self.path, valued), None)
        if there is not None and not self._resume:
            expected = "a new folder, or --overwrite" + (" or --resume" if self._needs else "")
            raise InputError("output exists", where=there, expected=expected)
        known = {*_matching(self.path, made)}
        if self._resume:
            known |= {*_matching(self.path, self._needs)}
        for path in _matching(self.path, self._makes):
            if not known & {path, *path.parents}:
                expected, found = "a new folder, or --overwrite, which removes it", "not of an earlier run"
                raise InputError("output exists", where=path, expected=expected, found=found)
        return made

    def _gone_on_from(self) -> set[Path]:
        """All files that a resumed run needs."""
        places = [*_matching(self.path, self._needs)]
        return {*places, *(path for place in places if place.is_dir() for path in place.rglob("*"))}

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None and self._old and self._gone_on_from() - self._began_with:
            left = [path for path in self._old if path.exists()]
            _remove(self.path, [path for path in left if path.stat().st_mtime_ns == self._old[path]])


def note_result(path: Path, source: Path, names: Sequence[str] = ()) -> None:
    """Add results made from a run to the record of that run, if they are in its folder: both are removed together.

    path: a file or a folder; with ``names``, which may have ``*``, the folder of these. source: the run's folder, or
    that of its frames within.
    """
    path, source = path.absolute(), source.absolute()
    for folder in (source, source.parent):
        if (folder / RECORD).is_file() and folder in (path / "any" if names else path).parents:
            command, made = _read(folder)
            place = PurePosixPath(glob.escape(path.relative_to(folder).as_posix()))
            found = [str(place / name) for name in names] or [f"{place}/" if path.is_dir() else str(place)]
            _write(folder, command, [*made, *found])
            return


def _made(folder: Path, command: str) -> list[str]:
    """What the record of a folder lists; InputError where that is of another command and something is left of it."""
    if not (folder / RECORD).is_file():
        return []
    owner, made = _read(folder)
    if owner != command and any(True for _ in _matching(folder, made)):
        raise InputError(
            f"folder holds results of '{owner}'", where=folder, expected=f"a folder of its own for '{command}'"
        )
    return made


def _read(folder: Path) -> tuple[str, list[str]]:
    try:
        content = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        return str(content["command"]), [str(name) for name in content["makes"]]
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError("record of a run cannot be read", where=folder / RECORD, expected="JSON") from None


def _write(folder: Path, command: str, makes: Sequence[str]) -> None:
    content = {"format": "yarnscale-run", "command": command, "makes": list(dict.fromkeys(makes))}
    write_text(folder / RECORD, json.dumps(content, indent=1) + "\n")


def _matching(folder: Path, names: Sequence[str]) -> Iterator[Path]:
    """Files and folders of these names, each once; nothing outside of the folder."""
    seen: set[Path] = set()
    for name in names:
        parts = PurePosixPath(name).parts
        if not parts or ".." in parts or PurePosixPath(name).is_absolute():
            continue
        for path in sorted(folder.glob(name.rstrip("/"))):
            inside = path.parent.resolve().is_relative_to(folder.resolve())
            wanted = path.is_dir() and not path.is_symlink() if name.endswith("/") else path.is_file()
            if inside and wanted and path not in seen:
                seen.add(path)
                yield path


def _remove(folder: Path, paths: Sequence[Path]) -> None:
    """Remove results, and folders that are empty then. A folder with a record of its own loses what that lists."""
    with system_errors(folder, "output cannot be removed"):
        for path in paths:
            if not path.is_dir():
                path.unlink()
            elif (path / RECORD).is_file():
                _remove(path, [*_matching(path, _read(path)[1])])
                (path / RECORD).unlink()
            else:
                shutil.rmtree(path)
        touched = {parent for path in paths for parent in (path, *path.parents) if folder in parent.parents}
        for place in sorted(touched, reverse=True):
            if place.is_dir() and not any(place.iterdir()):
                place.rmdir()


def check_place(folder: Path) -> None:
    """InputError where a folder could not be made or written, as far as can be seen without making it."""
    place = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not place.is_dir() or not os.access(place, os.W_OK):
        found = "no permission" if place.is_dir() else f"{place} is a file"
        raise InputError("output cannot be written", where=folder, expected="a folder", found=found)


def writable_folder(folder: Path) -> Path:
    """Create a folder and make sure that it can be written, before long work begins."""
    with system_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    return folder

"""Files are written whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from yarnscale.errors import InputError
from yarnscale.files import atomic
from yarnscale.files.atomic import write_bytes, write_text


def test_a_new_file_and_a_replaced_one(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "één\n")
    assert path.read_bytes() == "één\n".encode()
    os.chmod(path, 0o640)
    write_bytes(path, b"\x00\x01")
    assert path.read_bytes() == b"\x00\x01"
    assert path.stat().st_mode & 0o777 == 0o640
    assert os.listdir(tmp_path) == ["a.txt"]


def test_a_link_keeps_pointing_where_it_did(tmp_path: Path) -> None:
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to("real")
    write_text(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new"


def test_targets_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="output is a folder; expected the path of a file"):
        write_text(tmp_path, "x")
    with pytest.raises(InputError, match="output cannot be written; found No such file or directory"):
        write_text(tmp_path / "none" / "a.txt", "x")
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="output cannot be written"):
        write_text(tmp_path / "file" / "a.txt", "x")
    with pytest.raises(InputError, match="output cannot be written"):
        write_text(tmp_path / ("long" * 100), "x")
    assert os.listdir(tmp_path) == ["file"]


def test_a_failure_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(atomic.os, "fsync", fail)
    with pytest.raises(InputError, match="found No space left on device"):
        write_text(path, "new")
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]

"""Folders of results: an earlier run's go as a whole, a stranger's files stay, another command is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from yarnscale.errors import InputError
from yarnscale.files.run_folder import RECORD, RunFolder, note_result

MAKES = ("frames/frame_*.npz", "last.png", "store/")


def run(folder: Path, frames: int, *, others: tuple[str, ...] = (), **options: bool) -> None:
    goes_on = ("frames/frame_*.npz",)
    with RunFolder(folder, "cloth", (*MAKES, *others), goes_on_from=goes_on, **options) as path:  # type: ignore[arg-type]
        for name in [*(f"frames/frame_{k:04d}.npz" for k in range(frames)), *others]:
            written(path / name)


def written(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(path.name)
    return path


def names(folder: Path) -> set[str]:
    return {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file() and p.name != RECORD}


def test_a_shorter_run_leaves_nothing_of_a_longer_one_and_all_of_the_user(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    run(folder, 3, others=("cloth.glb", "obj/frame_0002.obj"))
    mine = {"notes.txt", "frames/notes.txt", "cloth.mp4", "obj/hair.obj"}
    for name in mine:
        written(folder / name)
    before = names(folder)
    with pytest.raises(InputError, match="output exists; expected a new folder, or --overwrite or --resume"):
        run(folder, 1)
    assert names(folder) == before
    run(folder, 1, overwrite=True)
    assert names(folder) == mine | {"frames/frame_0000.npz"}


def test_a_resumed_run_keeps_its_frames_and_drops_stale_exports(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    run(folder, 2, others=("cloth.glb", "last.png"))
    with RunFolder(folder, "cloth", MAKES, resume=True, goes_on_from=("frames/frame_*.npz",)) as path:
        assert (path / "cloth.glb").exists()
        written(path / "frames/frame_0002.npz")
        (path / "last.png").write_text("anew")
    assert names(folder) == {*(f"frames/frame_{k:04d}.npz" for k in range(3)), "last.png"}
    # The record still lists all: the next run removes them.
    run(folder, 1, overwrite=True)
    assert names(folder) == {"frames/frame_0000.npz"}


def test_what_is_made_of_a_run_goes_with_it_and_nothing_else(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    run(folder, 1)
    with RunFolder(folder / "yarns", "detail", ("frame_*.npz",)) as yarns:
        note_result(yarns, folder)
        written(yarns / "frame_0000.npz")
    note_result(written(folder / "film.mp4"), folder / "frames")
    note_result(written(tmp_path / "elsewhere.mp4"), folder)
    written(folder / "yarns" / "mine.txt")
    with RunFolder(folder / "other", "homogenize", ("material.json",)) as other:
        written(other / "material.json")
    run(folder, 1, overwrite=True)
    assert names(folder) == {"frames/frame_0000.npz", "yarns/mine.txt", "other/material.json"}
    assert (tmp_path / "elsewhere.mp4").exists()


def test_results_of_another_command_are_never_removed(tmp_path: Path) -> None:
    run(tmp_path, 1)
    for options in ({}, {"overwrite": True}, {"resume": True}):
        with pytest.raises(
            InputError, match="holds results of 'cloth'; expected a folder of its own for 'fabric'"
        ):
            RunFolder(tmp_path, "fabric", ("frame_*.npz",), **options)  # type: ignore[arg-type]
    assert names(tmp_path) == {"frames/frame_0000.npz"}


def test_a_run_that_came_to_nothing_stands_in_nobodys_way(tmp_path: Path) -> None:
    valued = ("frames/frame_*.npz",)
    with (
        pytest.raises(InputError, match="crossing"),
        RunFolder(tmp_path, "cloth", MAKES, valued=valued) as path,
    ):
        written(path / "last.png")
        raise InputError("crossing")
    with RunFolder(tmp_path, "cloth", MAKES, valued=valued):
        assert names(tmp_path) == set()


def test_a_record_cannot_point_out_of_its_folder(tmp_path: Path) -> None:
    outside, folder = written(tmp_path / "a" / "mine.txt"), tmp_path / "run"
    run(folder, 1)
    (folder / "link").symlink_to(outside.parent)
    content = '{"command": "cloth", "makes": ["../a/mine.txt", "%s", "link/mine.txt", "link/", "frames/*"]}'
    (folder / RECORD).write_text(content % outside)
    run(folder, 1, overwrite=True)
    assert outside.exists()
    (folder / RECORD).write_text("[]")
    with pytest.raises(InputError, match="record of a run cannot be read"):
        run(folder, 1, overwrite=True)

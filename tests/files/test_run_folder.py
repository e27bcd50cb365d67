"""Folders of results: an earlier run's go as a whole, a stranger's files stay, another command is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from yarnscale.cli.convert import made_by
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


def test_a_resumed_run_that_adds_nothing_keeps_exports(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    run(folder, 2, others=("cloth.glb",))
    note_result(written(folder / "film.mp4"), folder)
    before = names(folder)
    with RunFolder(folder, "cloth", MAKES, resume=True, goes_on_from=("frames/frame_*.npz",)) as path:
        written(path / "frames/frame_0001.npz")
    assert names(folder) == before


def test_files_that_no_run_made_are_refused_and_named(tmp_path: Path) -> None:
    """A run in a folder of the user's own: files of the names it makes go with --overwrite only."""
    valued = ("frames/frame_*.npz",)
    mine = written(tmp_path / "last.png")
    for options in ({}, {"resume": True}):
        with pytest.raises(InputError, match=r"last.png: output exists; expected .*--overwrite"):
            RunFolder(tmp_path, "cloth", MAKES, valued=valued, goes_on_from=valued, **options)  # type: ignore[arg-type]
    assert {p.name for p in tmp_path.iterdir()} == {mine.name}
    # What a run did not list is no more its own: here a format that the first run was not asked for.
    mine.unlink()
    run(tmp_path, 1)
    written(tmp_path / "cloth.glb")
    with pytest.raises(InputError, match=r"cloth.glb: output exists"):
        run(tmp_path, 1, others=("cloth.glb",), resume=True)
    run(tmp_path, 1, others=("cloth.glb",), overwrite=True)
    run(tmp_path, 1, overwrite=True)
    assert names(tmp_path) == {"frames/frame_0000.npz"}


def test_a_run_that_began_before_another_ended_does_not_remove_that(tmp_path: Path) -> None:
    late = RunFolder(tmp_path, "test", ("tests.json",))
    with RunFolder(tmp_path, "test", ("tests.json",)) as folder:
        written(folder / "tests.json")
    with pytest.raises(InputError, match=r"tests.json: output exists"), late:
        pytest.fail("the second run began")
    assert names(tmp_path) == {"tests.json"}


def test_names_of_the_user_are_taken_as_they_are(tmp_path: Path) -> None:
    run(tmp_path, 1)
    for name in ("film[1].mp4", "all*.mp4"):
        note_result(written(tmp_path / name), tmp_path)
    (tmp_path / "yarns?").mkdir()
    note_result(tmp_path / "yarns?", tmp_path)
    for name in ("a[1].pvd", "a[1]/cloth_0001.vtp"):
        written(tmp_path / name)
    note_result(tmp_path, tmp_path, made_by("vtk", "a[1].pvd"))
    mine = {"film1.mp4", "all of mine.mp4", "yarns2/mine.txt", "a1.pvd", "a1/cloth_0001.vtp"}
    for name in mine:
        written(tmp_path / name)
    run(tmp_path, 1, overwrite=True)
    assert names(tmp_path) == mine | {"frames/frame_0000.npz"}
    assert not (tmp_path / "yarns?").exists() and not (tmp_path / "a[1]").exists()


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
        with pytest.raises(InputError, match="holds results of 'cloth'; expected a folder of its own for 'fabric'"):
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

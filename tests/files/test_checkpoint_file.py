"""Checkpoints come back as they were, and belong to one scene."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.files.checkpoint_file import INTERVAL, CheckpointFile
from yarnscale.files.fingerprint import fingerprint
from yarnscale.motion.run import Run
from yarnscale.motion.unfulfilled import Unfulfilled
from yarnscale.numerics.newton import Status
from yarnscale.shell.dynamics.solver import SolverOptions
from yarnscale.shell.materials.orthotropic import JERSEY
from yarnscale.shell.scenes.scene import Scene, drape, stretch
from yarnscale.shell.state import ClothState, Earlier, Slips

MATERIAL = replace(JERSEY, stretch_coupling=5.0, area=0.0, log_area=0.0, bend_weft=2e-5, bend_bias=1e-5, bend_warp=2e-5)


def scene(**options) -> Scene:
    return drape(MATERIAL, spacing=0.05, **options)


def checkpoint(frames: int = 2, status: Status | None = None) -> Run:
    rng = np.random.default_rng(3)
    earlier = Earlier(rng.normal(size=(9, 3)), rng.normal(size=(9, 3)), 0.02)
    places = [rng.normal(size=shape) for shape in ((9, 3), (9, 3), (4, 3), (5, 3))]
    slips = Slips(rng.integers(-1, 9, (6, 5)), rng.normal(size=(6, 3)))
    state = ClothState(places[0], places[1], 0.3, places[2], earlier, places[3], slips)
    gave_way = Unfulfilled("handle 'pin'", 0.1, 3e-3, 1e-4)
    return Run(state, 0.1, status, frames, 0.4, True, 7, 31, 40, 2, math.inf, 0.025, 3, {"crossed": 1}, (gave_way,))


def file_in(folder: Path, of: Scene | None = None) -> CheckpointFile[ClothState]:
    return CheckpointFile(folder / "Prüfpunkt 1.npz", ClothState, (of or scene()).settings)


@pytest.mark.parametrize("status", [None, Status.CONVERGED])
def test_a_checkpoint_comes_back(tmp_path, status) -> None:
    file = file_in(tmp_path)
    with pytest.raises(InputError, match="nothing to resume"):
        file.read()
    written = checkpoint(status=status)
    file.write(written)
    read = file.read()
    for field in fields(Run):
        if field.name != "state":
            assert getattr(read, field.name) == getattr(written, field.name), field.name
    assert read.state.before is not None and written.state.before is not None
    for field in fields(Earlier):
        np.testing.assert_array_equal(getattr(read.state.before, field.name), getattr(written.state.before, field.name))
    assert read.state.slips is not None and written.state.slips is not None
    np.testing.assert_array_equal(read.state.slips.between, written.state.slips.between)
    np.testing.assert_array_equal(read.state.slips.amounts, written.state.slips.amounts)
    for field in fields(ClothState):
        if field.name in ("before", "slips"):
            continue
        np.testing.assert_array_equal(getattr(read.state, field.name), getattr(written.state, field.name))


def test_what_is_none_stays_none(tmp_path) -> None:
    file = file_in(tmp_path)
    file.write(replace(checkpoint(), state=replace(checkpoint().state, fold_angles=None), rest_step=None))
    read = file.read()
    assert read.rest_step is None and read.state.fold_angles is None


def test_it_is_written_after_frames_and_now_and_then(tmp_path, monkeypatch) -> None:
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    file = file_in(tmp_path)

    def steps_after(place: Run) -> int:
        file.write(place)
        return file.read().steps

    assert steps_after(checkpoint()) == 7
    assert steps_after(replace(checkpoint(), steps=8)) == 7
    assert steps_after(replace(checkpoint(3), steps=9)) == 9
    now[0] += INTERVAL
    assert steps_after(replace(checkpoint(3), steps=10)) == 10
    assert steps_after(replace(checkpoint(3), steps=11, status=Status.CONVERGED)) == 11


def test_a_resumed_run_writes_after_its_next_frame_and_not_before(tmp_path) -> None:
    file_in(tmp_path).write(checkpoint())
    path = file_in(tmp_path).path
    file = CheckpointFile(path, ClothState, scene().settings, interval=math.inf)
    place = file.read()
    file.write(replace(place, steps=8, shown=False))
    assert file_in(tmp_path).read().steps == 7
    file.write(replace(place, steps=9, frames=3))
    assert file_in(tmp_path).read().steps == 9


def test_other_settings_are_refused_by_name(tmp_path) -> None:
    file_in(tmp_path).write(checkpoint())
    whole = scene()
    others = {
        "another cloth": scene(radius=0.08),
        "another schedule": scene(duration=2.0),
        "another cloth, another start, another schedule": stretch(MATERIAL, spacing=0.05),
        "another cloth$": drape(replace(MATERIAL, shear=21.0), spacing=0.05),
        "another options": replace(whole, options=SolverOptions(tolerance=0.02)),
        "another start": replace(whole, start=ClothState(whole.start.positions + 1e-9, whole.start.velocities)),
    }
    for said, other in others.items():
        with pytest.raises(InputError, match=f"cannot be resumed.*found {said}"):
            file_in(tmp_path, other).read()


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"no zip"])
def test_a_damaged_file_is_named(tmp_path, content) -> None:
    file = file_in(tmp_path)
    file.path.write_bytes(content)
    with pytest.raises(InputError, match=r"1.npz: file is no checkpoint"):
        file.read()


def test_fingerprints_tell_kinds_apart() -> None:
    values = [
        1,
        1.0,
        True,
        "1",
        None,
        (1,),
        (1, 1),
        {"a": 1},
        {"a": 1.0},
        np.ones(2),
        np.ones((2, 1)),
        [np.ones(1)],
    ]
    assert len({fingerprint(value) for value in values}) == len(values)
    assert fingerprint(*values) == fingerprint(*values)
    with pytest.raises(TypeError):
        fingerprint(object())

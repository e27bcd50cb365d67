"""The command ``convert``: frames of a run to the formats of other programs, to movies and to pictures."""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Callable, Iterable
from importlib.util import find_spec
from pathlib import Path

from yarnscale.cli.console import ProgressLine, writable_file, writable_folder
from yarnscale.errors import InputError
from yarnscale.files.animation import Animation, Moment, read_animation

NAMES = {
    "obj": "obj",
    "gltf": "cloth.glb",
    "usd": "cloth.usdc",
    "vtk": "cloth.pvd",
    "mp4": "cloth.mp4",
    "png": "png",
}
"""Where ``simulate --format`` writes, in the folder of the run."""
_FILES = {"gltf": (".glb",), "usd": (".usdc", ".usda", ".usd"), "vtk": (".pvd",), "mp4": (".mp4",)}
_PACKAGES = {"usd": "pxr", "mp4": "av"}


def convert(options: argparse.Namespace) -> int:
    """Convert the frames of a run."""
    require(options.to)
    animation = read_animation(options.frames, yarns=options.yarns)
    write(animation, options.to, options.out, options)
    print(f"{options.out}: {len(animation)} frames")
    return 0


def require(kind: str) -> None:
    """Raise InputError where the package or the renderer that a format needs is missing."""
    package = _PACKAGES.get(kind)
    if package is not None and find_spec(package) is None:
        name = "usd-core" if kind == "usd" else package
        raise InputError(
            f"{kind} files need the package {name}", expected="pip install 'yarnscale[export]'", found="none"
        )
    if kind in ("mp4", "png"):
        from yarnscale.show.canvas import require_renderer

        require_renderer()


def write(animation: Animation, kind: str, out: Path, options: argparse.Namespace | None = None) -> None:
    """Write an animation as one of the kinds of ``--to``; without ``options`` as the command does by default."""
    if kind in _FILES:
        writable_file(out, *_FILES[kind])
    else:
        writable_folder(out)
        _remove_frames(out, kind)
    line, began, count = ProgressLine(f"writing {kind}"), time.perf_counter(), len(animation)

    def told(done: int) -> None:
        seconds = time.perf_counter() - began
        line.show(done, count, seconds, seconds / done * (count - done))

    chosen = vars(options) if options is not None else {}
    fps = chosen.get("fps") or 30.0
    look = {name: chosen[name] for name in ("colour", "camera", "wires") if chosen.get(name)}
    if kind == "usd":
        from yarnscale.files.usd import write_usd

        write_usd(out, animation, fps=fps, on_frame=told)
    elif kind == "gltf":
        from yarnscale.files.gltf import write_gltf

        write_gltf(out, animation, yarns_as=chosen.get("yarns_as") or "tubes", on_frame=told)
    elif kind == "mp4":
        from yarnscale.show.movie import write_movie

        write_movie(out, animation, fps=fps, speed=chosen.get("speed") or 1.0, on_frame=told, **look)
    elif kind == "png":
        from yarnscale.show.movie import write_stills

        write_stills(out, animation, on_frame=told, **look)
    else:
        _write_each(animation, _frame_writer(animation, kind, out), told)


def _frame_writer(animation: Animation, kind: str, out: Path) -> Callable[[int, Moment], None]:
    if kind == "vtk":
        from yarnscale.files.vtk_series import VtkSeries

        return VtkSeries(out, animation).write
    if kind == "obj":
        from yarnscale.files.obj_sequence import write_obj_frame

        return lambda number, moment: write_obj_frame(out / f"frame_{number:04d}.obj", animation, moment)
    from yarnscale.files.bcc import write_bcc

    curves = animation.yarns
    if curves is None:
        raise InputError(
            "BCC files hold curves", expected="frames of yarns (--yarns DIR)", found="cloth only"
        )

    def write_curves(number: int, moment: Moment) -> None:
        assert moment.yarns is not None
        write_bcc(out / f"frame_{number:04d}.bcc", curves, moment.yarns)

    return write_curves


def _write_each(
    frames: Iterable[Moment], write_one: Callable[[int, Moment], None], told: Callable[[int], None]
) -> None:
    for number, moment in enumerate(frames):
        write_one(number, moment)
        told(number + 1)


def _remove_frames(folder: Path, kind: str) -> None:
    """Frames of an earlier and perhaps longer run would stand among the new ones."""
    for path in folder.iterdir():
        if re.fullmatch(rf"frame_\d{{4,}}\.{kind}", path.name):
            path.unlink()

"""The command ``convert``: frames of a run to the formats of other programs, to movies and to pictures."""

from __future__ import annotations

import argparse
import glob
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from yarnscale.cli.console import ProgressLine, print_notice, report, writable_file
from yarnscale.errors import InputError
from yarnscale.files.animation import Animation, Moment, read_animation
from yarnscale.files.run_folder import RunFolder, note_result, writable_folder

if TYPE_CHECKING:
    from yarnscale.files.tube_detail import TubeDetail

NAMES = {"obj": "obj", "gltf": "cloth.glb", "usd": "cloth.usdc", "vtk": "cloth.pvd", "mp4": "cloth.mp4", "png": "png"}
"""Where ``simulate --format`` writes, in the folder of the run."""
_FILES = {"gltf": (".glb",), "usd": (".usdc", ".usda", ".usd"), "vtk": (".pvd",), "mp4": (".mp4",)}
_PACKAGES = {"usd": "pxr", "mp4": "av"}


def convert(options: argparse.Namespace) -> int:
    """Convert the frames of a run."""
    require(options.format)
    animation = read_animation(options.frames, yarns=options.yarns)
    if options.chosen is not None:
        animation = animation.among(options.chosen.of(animation.numbers))
    elif options.format == "gltf" and options.yarns_as == "tubes" and animation.yarns is not None:
        last = animation.numbers[-1]
        if len(animation) > 1:
            print_notice(
                f"frame {last} of {animation.numbers[0]} to {last}; --frames FIRST:LAST:STEP takes several, and "
                "--yarns-as lines or --format usd are smaller"
            )
        animation = animation.among([last])
    kind, out = options.format, options.out
    if kind in _FILES:
        writable_file(out, *_FILES[kind])
        note_result(out.parent, options.frames, made_by(kind, out.name))
        write(animation, kind, out, options)
    else:
        makes = [Path(name).name for name in made_by(kind, "")]
        with RunFolder(out, f"convert --format {kind}", makes, overwrite=options.overwrite):
            note_result(out, options.frames)
            write(animation, kind, out, options)
    size = f", {options.out.stat().st_size / 1e6:.3g} MB" if options.out.is_file() else ""
    summary = {"out": str(out), "format": kind, "frames": len(animation)}
    summary["bytes"] = out.stat().st_size if size else None
    report(options, summary, f"{out}: {len(animation)} frame{'s' if len(animation) > 1 else ''}{size}")
    return 0


def made_by(kind: str, name: str) -> list[str]:
    """Names, with ``*``, of the files that a conversion writes as ``name``, beside and below it."""
    name = glob.escape(name)
    if kind == "vtk":
        return [name, *(f"{Path(name).stem}/{part}_*.vtp" for part in ("cloth", "bodies", "yarns"))]
    return [name] if kind in _FILES else [f"{name}/frame_*.{kind}"]


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
    """Write an animation as one of the kinds of ``--format``; without ``options`` as the command does by default."""
    if kind in _FILES:
        writable_file(out, *_FILES[kind])
    else:
        writable_folder(out)
    line, count = ProgressLine(f"writing {kind}"), len(animation)

    def show(done: int) -> None:
        # Closing the file counts as one more frame: until then it is not finished.
        line.show(done, count + 1, f"frame {done} of {count}")

    try:
        _write(animation, kind, out, vars(options) if options is not None else {}, show)
    except KeyboardInterrupt as interrupt:
        if interrupt.args or kind not in _FILES or kind == "vtk":
            raise
        raise KeyboardInterrupt(f"nothing is kept of {out}, which is written whole or not at all") from None
    line.show(count + 1, count + 1)


def _write(
    animation: Animation, kind: str, out: Path, chosen: Mapping[str, Any], on_frame: Callable[[int], None]
) -> None:
    fps = chosen.get("fps") or 30.0
    look = {name: chosen[name] for name in ("colour", "camera", "wires") if chosen.get(name)}
    if kind == "usd":
        from yarnscale.files.usd import write_usd

        write_usd(out, animation, fps=fps, on_frame=on_frame)
    elif kind == "gltf":
        from yarnscale.files.gltf import write_gltf

        yarns_as = chosen.get("yarns_as") or "tubes"
        detail = None if yarns_as == "lines" else _tube_detail(animation, chosen.get("megabytes") or 50.0)
        write_gltf(out, animation, yarns_as=yarns_as, detail=detail, on_frame=on_frame)
    elif kind == "mp4":
        from yarnscale.show.movie import write_movie

        write_movie(out, animation, fps=fps, speed=chosen.get("speed") or 1.0, on_frame=on_frame, **look)
    elif kind == "png":
        from yarnscale.show.movie import write_stills

        write_stills(out, animation, on_frame=on_frame, **look)
    else:
        write_one = _frame_writer(animation, kind, out)
        for done, (number, moment) in enumerate(zip(animation.numbers, animation, strict=True), start=1):
            write_one(number, moment)
            on_frame(done)


def _tube_detail(animation: Animation, megabytes: float) -> TubeDetail | None:
    """Tubes as fine as a size of a frame allows, said beforehand with the size that is to be expected."""
    if animation.yarns is None:
        return None
    from yarnscale.files.tube_detail import fitting_detail, level_of

    first = animation.moment(0)
    assert first.yarns is not None
    detail, size = fitting_detail(animation.yarns, first.yarns, 1e6 * megabytes)
    share = level_of(animation.yarns, first.yarns, detail)[0].point_count / animation.yarns.point_count
    # Later frames are differences of positions and normals.
    whole = size * (1.0 + (len(animation) - 1) * 24 / 36)
    print_notice(
        f"about {whole / 1e6:.3g} MB: tubes of {detail.sides} sides, {100 * share:.0f} % of the points, to within "
        f"{detail.tolerance:g} radii (--megabytes takes more or fewer)"
    )
    return detail


def _frame_writer(animation: Animation, kind: str, out: Path) -> Callable[[int, Moment], None]:
    if kind == "vtk":
        from yarnscale.files.vtk_series import VtkSeries

        return VtkSeries(out, animation).write
    if kind == "obj":
        from yarnscale.files.obj import write_obj_frame

        return lambda number, moment: write_obj_frame(out / f"frame_{number:04d}.obj", animation, moment)
    from yarnscale.files.bcc import write_bcc

    curves = animation.yarns
    if curves is None:
        raise InputError("BCC files hold curves", expected="frames of yarns (--yarns DIR)", found="cloth only")

    def write_curves(number: int, moment: Moment) -> None:
        assert moment.yarns is not None
        write_bcc(out / f"frame_{number:04d}.bcc", curves, moment.yarns)

    return write_curves

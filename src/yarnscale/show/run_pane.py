"""Panes that play the frames of a run: cloth, yarns and bodies, as many frames as a page holds."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.files.animation import Animation, Moment, Surface
from yarnscale.files.curve_frames import CurveSet
from yarnscale.files.tube_detail import thinned
from yarnscale.shell.elastic.elements import shell_elements
from yarnscale.shell.elastic.out_of_range import outside_of
from yarnscale.shell.materials.compact import CompactMaterial
from yarnscale.shell.mesh import TriangleMesh
from yarnscale.show import theme
from yarnscale.show.canvas import Camera, view_axes
from yarnscale.show.movie import vertex_stretch
from yarnscale.show.pane import Pane, framed

MEGABYTES = 3.0
"""Of a pane in its page, about."""
_FRAMES, _FEWEST = 60, 12
"""Most frames of a pane, and as many as yarns are thinned for."""
_POINTS = 150_000
"""Most points of yarns that a browser draws at a bearable speed."""
_THINNER = (0.0, 0.05, 0.15, 0.4, 1.0, 2.0)
"""Tolerances of thinning, in radii."""
_LEVELS = 65535


def run_pane(
    animation: Animation,
    title: str,
    *,
    material: object = None,
    camera: Camera | Sequence[float] = "oblique",
    megabytes: float = MEGABYTES,
) -> Pane:
    """The frames of a run, evenly chosen so that the pane takes about so many megabytes of its page.

    material: of the cloth; one with samples colours the cloth by its distance from them. Yarns are thinned where there
    are many, and drawn in place of the cloth. Raises InputError where not even one frame has room.
    """
    if animation.yarns is not None:
        animation = _thinned(replace(animation, cloth=None), megabytes)
    first = animation.moment(len(animation) - 1)
    each = _packed_size(first)
    count = int(min(1e6 * megabytes / each, _FRAMES, len(animation)))
    if count < 1:
        found = f"{each / 1e6:.0f} MB for a single frame"
        raise InputError("run is too large for a page", expected=f"at most {megabytes:g} MB", found=found)
    chosen = np.unique(np.linspace(len(animation) - 1, 0, count).round().astype(int))
    moments = [animation.moment(int(k)) for k in chosen]
    return _pane(animation, moments, title, material, camera)


def _pane(
    animation: Animation, moments: list[Moment], title: str, material: object, camera: Camera | Sequence[float]
) -> Pane:
    frames = {name: [getattr(moment, name) for moment in moments] for name in ("cloth", "yarns", "bodies")}
    drawn = [name for name in frames if getattr(animation, name) is not None]
    seen = {name: np.stack(frames[name]) for name in drawn}
    everything = np.vstack([frames.reshape(-1, 3) for frames in seen.values()])
    fabric = np.vstack([frames.reshape(-1, 3) for name, frames in seen.items() if name != "bodies"])
    low, high = everything.min(axis=0), everything.max(axis=0)
    step = max(float((high - low).max()), 1e-9) / _LEVELS
    arrays: dict[str, NDArray] = {name: _planes(frames, low, step) for name, frames in seen.items()}
    colours: list[dict[str, object]] = [{"name": "right and wrong side" if "cloth" in seen else "yarns"}]
    header: dict[str, object] = {"cloth_colours": [theme.CLOTH_FRONT, theme.CLOTH_BACK]}
    if (surface := animation.cloth) is not None:
        arrays["triangles"] = surface.triangles
        if surface.material is not None:
            values = np.stack([vertex_stretch(surface, frame) for frame in seen["cloth"]]) - 1.0
            words = {"factor": 100, "unit": "%", "label": "largest stretch"}
            colours.append(_field("stretch", "cloth", "stretch", values, words, arrays))
        if isinstance(material, CompactMaterial) and surface.corners is not None:
            values = _outside(surface, seen["cloth"], material)
            words = {"factor": 1, "unit": "spacings", "label": "distance from the samples"}
            colours.append(_field("distance from samples", "cloth", "outside", values, words, arrays))
    if (curves := animation.yarns) is not None:
        arrays |= {
            "offsets": curves.offsets, "closed": curves.closed, "yarn": curves.yarn,
            "radius": curves.radii[curves.offsets[:-1]],
        }  # fmt: skip
        if len(moments) > 1:
            values = _yarn_stretch(curves, seen["yarns"])
            words = {"factor": 100, "unit": "%", "label": "stretch of yarn since the first frame"}
            colours.append(_field("stretch of yarn", "yarns", "stretch", values, words, arrays))
    if animation.bodies is not None:
        arrays["body_triangles"] = animation.bodies.triangles
    axes = view_axes(camera)
    header |= {
        "times": [moment.time for moment in moments], "grid": {"low": low.tolist(), "step": step}, "colours": colours,
        "eye": axes[2].tolist(), "up": _nearest_axis(axes[1]),
        "box": [*fabric.min(axis=0).tolist(), *fabric.max(axis=0).tolist()], **framed(fabric),
    }  # fmt: skip
    return Pane(title, header, arrays)


def _nearest_axis(direction: Array) -> list[float]:
    """The coordinate axis, or its opposite, that is nearest to a direction (3,)."""
    place = int(np.abs(direction).argmax())
    return [float(np.sign(direction[k])) if k == place else 0.0 for k in range(3)]


def _planes(frames: Array, low: Array, step: float) -> NDArray[np.uint8]:
    """Positions (nf, n, 3) as 16-bit numbers: low bytes, then high bytes, of differences from frame to frame."""
    levels = np.rint((frames - low) / step).astype(np.uint16).reshape(len(frames), -1)
    levels[1:] -= levels[:-1].copy()
    flat = levels.ravel()
    return np.concatenate([flat & 255, flat >> 8]).astype(np.uint8)


def _field(
    name: str, part: str, array: str, values: Array, words: dict[str, object], arrays: dict[str, NDArray]
) -> dict[str, object]:
    """A choice of colours by values (nf, n), kept in 8 bits between their first and last percents."""
    low, high = (float(v) for v in np.percentile(values, [1.0, 99.0]))
    low = 0.0 if 0.0 < low < 0.2 * high else low
    high = max(high, low + 1e-4)
    arrays[array] = np.rint(255 * np.clip((values - low) / (high - low), 0.0, 1.0)).astype(np.uint8)
    return {"name": name, "fields": {part: {"array": array, "low": low, "high": high, **words}}}


def _outside(surface: Surface, frames: Array, material: CompactMaterial) -> Array:
    """Distance from the samples, the largest of a vertex's triangles, (nf, nv)."""
    assert surface.material is not None and surface.corners is not None
    mesh = TriangleMesh(surface.material, surface.triangles, corners=surface.corners, assembled=frames[0])
    elements, values = shell_elements(mesh), np.zeros(frames.shape[:2])
    there, vertices = elements.areas.ravel() > 0.0, surface.triangles[elements.triangles.ravel()]
    for row, positions in zip(values, frames, strict=True):
        elements.follow(positions)
        found = np.where(there, outside_of(elements, material, positions), 0.0)
        np.maximum.at(row, vertices, found[:, None])
    return values


def _yarn_stretch(curves: CurveSet, frames: Array) -> Array:
    """Stretch since the first frame of the segment at every point, (nf, n)."""
    segments = curves.segments()
    lengths = np.linalg.norm(frames[:, segments[:, 1]] - frames[:, segments[:, 0]], axis=2)
    values = np.zeros(frames.shape[:2])
    values[:, segments[:, 1]] = values[:, segments[:, 0]] = lengths / np.maximum(lengths[0], 1e-12) - 1.0
    return values


def _thinned(animation: Animation, megabytes: float) -> Animation:
    """Yarns with as few points as a page and a browser bear, thinned in the last frame."""
    curves = animation.yarns
    assert curves is not None
    last = animation.moment(len(animation) - 1)
    assert last.yarns is not None
    few, chosen = curves, np.arange(curves.point_count)
    for tolerance in _THINNER:
        few, chosen = thinned(curves, last.yarns, tolerance * float(curves.radii.max()))
        size = 4.0 * len(chosen) * min(_FEWEST, len(animation))
        if size < 1e6 * megabytes and len(chosen) < _POINTS:
            break

    def moment(index: int) -> Moment:
        full = animation.moment(index)
        assert full.yarns is not None
        return replace(full, yarns=full.yarns[chosen], radii=None)

    return replace(animation, yarns=few, moment=moment)


def _packed_size(moment: Moment) -> float:
    """Bytes that a frame takes in a page, about."""
    parts = [
        part for part in (moment.yarns if moment.yarns is not None else moment.cloth, moment.bodies) if part is not None
    ]
    low = min(float(part.min()) for part in parts)
    step = max(max(float(part.max()) for part in parts) - low, 1e-9) / _LEVELS
    # A frame's differences are about as long as half of its own numbers; fields of 8 bits come on top; base64.
    size = sum(len(zlib.compress(_planes(part[None], np.full(3, low), step).tobytes())) for part in parts)
    return 4 / 3 * (0.7 * size + sum(len(part) for part in parts))

"""glTF 2.0, binary (.glb): cloth, bodies and yarns as meshes whose frames are morph targets."""

from __future__ import annotations

import json
import os
import struct
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np
from numpy.typing import NDArray

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError, system_errors
from yarnscale.files.animation import Animation, Moment, Surface, vertex_normals
from yarnscale.files.atomic import replacement
from yarnscale.files.colours import colour_of, yarn_name
from yarnscale.files.tube_detail import LARGEST_PIECE, TubeDetail, Tubes
from yarnscale.version import __version__

Shape = tuple[Array, Array | None]
"""Positions [m] and normals (n, 3) of a mesh in one frame; lines have no normals."""

_FLOAT, _UNSIGNED, _SHORT, _TRIANGLES, _LINES = 5126, 5125, 5123, 4, 1
_VERTICES, _INDICES = 34962, 34963
_LARGEST = 2**32 - 2**20
"""Bytes that a binary glTF can count, less a megabyte for its text."""


def write_gltf(
    path: str | os.PathLike[str],
    animation: Animation,
    *,
    yarns_as: Literal["tubes", "lines"] = "tubes",
    detail: TubeDetail | None = None,
    on_frame: Callable[[int], None] | None = None,
) -> None:
    """Write an animation as one .glb file; frames are read one by one.

    The first frame is the mesh, every later one a morph target with positions and normals; one animation, in seconds
    from the first frame, goes through them. Metres; y is up, as glTF has it, by a rotation of the root. The texture
    coordinates of the cloth are its material coordinates [m]. Tubes are shown instead of the cloth.
    detail: of tubes, default eight sides about all points. on_frame: called with the number of frames done.

    Raises InputError where the file cannot be written or would pass the 4 GiB of the format.
    """
    target = Path(path)
    with system_errors(path), tempfile.TemporaryFile(dir=target.parent) as data:
        file = _Gltf(data)
        meshes = _meshes(animation, yarns_as, detail or TubeDetail())
        size = sum(mesh.bytes_per_frame for mesh in meshes) * len(animation)
        if size > _LARGEST:
            raise InputError(
                "binary glTF holds 4 GiB at most",
                where=path,
                expected="fewer frames (--frames FIRST:LAST:STEP), --yarns-as lines, or --format usd",
                found=f"{size / 2**30:.1f} GiB",
            )
        for k, moment in enumerate(animation):
            for mesh in meshes:
                if k == 0 or mesh.moves:
                    file.add_shape(mesh, *mesh.shape(moment))
            if on_frame is not None:
                on_frame(k + 1)
        file.write(target, meshes, animation.times)


_Part = tuple[slice, Integers, str]
"""Rows of a mesh's vertices, indices counted from the first of them, and the name of a material."""


@dataclass(eq=False)
class _Mesh:
    """One mesh: its constant parts, the function from a frame to its shape, and accessors by frame and part."""

    name: str
    mode: int
    parts: list[_Part]
    shape: Callable[[Moment], Shape]
    vertex_count: int
    material: Array | None = None
    moves: bool = True
    targets: list[list[dict[str, int]]] = field(default_factory=list)
    base: Shape | None = None

    @property
    def bytes_per_frame(self) -> int:
        return self.vertex_count * (24 if self.mode == _TRIANGLES else 12) * self.moves


def _meshes(animation: Animation, yarns_as: str, detail: TubeDetail) -> list[_Mesh]:
    first, curves = animation.moment(0), animation.yarns
    tubes, meshes = curves is not None and yarns_as == "tubes", []
    if animation.cloth is not None and not tubes:
        meshes.append(_cloth(animation.cloth))
    if animation.bodies is not None:
        triangles, start = animation.bodies.triangles, _there(first.bodies)
        moves = any(not np.array_equal(_there(m.bodies), start) for m in animation)
        parts, count = _whole("bodies", triangles), len(start)
        meshes.append(_Mesh("bodies", _TRIANGLES, parts, lambda m: _smooth(m.bodies, triangles), count, moves=moves))
    if curves is not None and tubes:
        swept = Tubes.of(curves, _there(first.yarns), detail)
        parts = [(rows, indices, yarn_name(kind)) for rows, indices, kind in swept.pieces]
        count = swept.sweep.curves.point_count * detail.sides
        meshes.append(
            _Mesh("yarns", _TRIANGLES, parts, lambda m: swept.surface(_there(m.yarns), _there(m.radii)), count)
        )
    elif curves is not None:
        parts, count = _whole("yarns", curves.segments()), curves.point_count
        meshes.append(_Mesh("yarns", _LINES, parts, lambda m: (_there(m.yarns), None), count))
    return meshes


def _whole(name: str, indices: Integers) -> list[_Part]:
    """A mesh of one part."""
    return [(slice(None), indices, name)]


def _cloth(surface: Surface) -> _Mesh:
    """The cloth, with a vertex for every material point: glTF has one texture coordinate a vertex."""
    triangles = surface.triangles
    count = int(triangles.max(initial=-1)) + 1
    if surface.material is None:
        return _Mesh("cloth", _TRIANGLES, _whole("cloth", triangles), lambda m: _smooth(m.cloth, triangles), count)
    corners = triangles if surface.corners is None else surface.corners
    vertex = np.zeros(len(surface.material), np.int64)
    vertex[corners] = triangles

    def shape(moment: Moment) -> Shape:
        positions, normals = _smooth(moment.cloth, triangles)
        return positions[vertex], normals[vertex]

    return _Mesh("cloth", _TRIANGLES, _whole("cloth", corners), shape, len(vertex), surface.material)


def _smooth(vertices: Array | None, triangles: Integers) -> tuple[Array, Array]:
    positions = _there(vertices)
    return positions, vertex_normals(positions, triangles)


def _there(values: Array | None) -> Array:
    if values is None:
        raise InputError("frame", expected="the same parts in every frame", found="one of them missing")
    return values


class _Gltf:
    """The parts of the file as they come: numbers go to ``data``, their description is kept."""

    def __init__(self, data: IO[bytes]) -> None:
        self.data = data
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, Any]] = []

    def add_shape(self, mesh: _Mesh, positions: Array, normals: Array | None) -> None:
        """The first frame as it is, later ones as differences to it."""
        if mesh.base is None:
            mesh.base = positions, normals
            change, turn = positions, normals
        else:
            base, facing = mesh.base
            change = positions - base
            turn = normals - facing if normals is not None and facing is not None else None
        targets = []
        for rows, _, _ in mesh.parts:
            target = {"POSITION": self.add(change[rows], "VEC3", use=_VERTICES, bounds=True)}
            if turn is not None:
                target["NORMAL"] = self.add(turn[rows], "VEC3", use=_VERTICES)
            targets.append(target)
        mesh.targets.append(targets)

    def add(self, values: NDArray, kind: str, *, use: int | None = None, bounds: bool = False) -> int:
        """Append numbers; returns their accessor."""
        floats = values.dtype.kind == "f"
        short = not floats and int(values.max(initial=0)) < LARGEST_PIECE
        array = np.ascontiguousarray(values, dtype="<f4" if floats else "<u2" if short else "<u4")
        view: dict[str, int] = {"buffer": 0, "byteOffset": self.data.tell(), "byteLength": array.nbytes}
        if use is not None:
            view["target"] = use
        self.data.write(array.tobytes() + b"\0" * (-array.nbytes % 4))
        count = array.size if kind == "SCALAR" else len(array)
        accessor: dict[str, Any] = {
            "bufferView": len(self.views),
            "componentType": _FLOAT if floats else _SHORT if short else _UNSIGNED,
            "count": count,
            "type": kind,
        }
        if bounds:
            flat = array.reshape(count, -1)
            accessor |= {"min": flat.min(axis=0).tolist(), "max": flat.max(axis=0).tolist()}
        self.views.append(view)
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def write(self, path: Path, meshes: list[_Mesh], times: Array) -> None:
        """The whole file, in one step."""
        content = self._description(meshes, times)
        size = self.data.tell()
        content["buffers"] = [{"byteLength": size}]
        text = json.dumps(content, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        with replacement(path) as temporary, open(temporary, "wb") as stream:
            stream.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + size))
            stream.write(struct.pack("<I4s", len(text), b"JSON") + text)
            stream.write(struct.pack("<I4s", size, b"BIN\0"))
            self.data.seek(0)
            while block := self.data.read(2**24):
                stream.write(block)

    def _description(self, meshes: list[_Mesh], times: Array) -> dict[str, Any]:
        nodes, shapes = [], []
        names = list(dict.fromkeys(name for mesh in meshes for _, _, name in mesh.parts))
        for k, mesh in enumerate(meshes):
            primitives = []
            for number, (_, indices, name) in enumerate(mesh.parts):
                attributes = dict(mesh.targets[0][number])
                if mesh.material is not None:
                    attributes["TEXCOORD_0"] = self.add(mesh.material, "VEC2", use=_VERTICES)
                primitive: dict[str, Any] = {
                    "attributes": attributes,
                    "indices": self.add(indices.ravel(), "SCALAR", use=_INDICES),
                    "mode": mesh.mode,
                    "material": names.index(name),
                }
                if later := mesh.targets[1:]:
                    primitive["targets"] = [targets[number] for targets in later]
                primitives.append(primitive)
            shape: dict[str, Any] = {"name": mesh.name, "primitives": primitives}
            if later := mesh.targets[1:]:
                shape["weights"] = [0.0] * len(later)
            shapes.append(shape)
            nodes.append({"name": mesh.name, "mesh": k})
        materials = [
            {
                "name": name,
                "doubleSided": name == "cloth",
                "pbrMetallicRoughness": {
                    "baseColorFactor": [*colour_of(name), 1.0],
                    "metallicFactor": 0.0,
                    "roughnessFactor": 0.9,
                },
            }
            for name in names
        ]
        half = float(np.sqrt(0.5))
        root = {"name": "yarnscale", "rotation": [-half, 0.0, 0.0, half], "children": list(range(len(nodes)))}
        content: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": f"yarnscale {__version__}"},
            "scene": 0,
            "scenes": [{"nodes": [len(nodes)]}],
            "nodes": [*nodes, root],
            "meshes": shapes,
            "materials": materials,
        }
        if moving := [k for k, mesh in enumerate(meshes) if len(mesh.targets) > 1]:
            content["animations"] = [self._animation(moving, times)]
        return content | {"accessors": self.accessors, "bufferViews": self.views}

    def _animation(self, nodes: list[int], times: Array) -> dict[str, Any]:
        """Weights that are one for the frame of a time and zero for all others."""
        weights = np.eye(len(times))[:, 1:]
        sampler = {
            "input": self.add(times - times[0], "SCALAR", bounds=True),
            "output": self.add(weights.ravel(), "SCALAR"),
            "interpolation": "LINEAR",
        }
        channels = [{"sampler": 0, "target": {"node": node, "path": "weights"}} for node in nodes]
        return {"name": "simulation", "samplers": [sampler], "channels": channels}

"""VTK files for ParaView: a .vtp file a frame and part, and a .pvd file that lists them by time."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import quoteattr, unescape

import numpy as np

from yarnscale.errors import system_errors
from yarnscale.files.animation import Animation, Moment, vertex_normals
from yarnscale.files.atomic import write_bytes, write_text


class VtkSeries:
    """``NAME.pvd`` beside a folder ``NAME`` with ``cloth_0000.vtp`` and so on, ``bodies_…``, ``yarns_…``.

    The list is written anew with every frame, so that a run can be watched. Points are in metres, times in seconds.
    Cloth carries Velocity [m/s] and, where vertices have one material point, MaterialCoordinates [m]; yarns carry
    Radius [m], Yarn and Curve.
    """

    def __init__(self, path: str | os.PathLike[str], animation: Animation) -> None:
        self.path, self.animation = Path(path), animation
        self.folder = self.path.with_suffix("")
        self._entries: list[str] = []
        self._remove_earlier()

    def _remove_earlier(self) -> None:
        """Remove the files of the series that this one replaces: those that its list names."""
        if self.path.is_file():
            for name in re.findall(r'file="([^"/]+/\w+_\d{4,}\.vtp)"', self.path.read_text(encoding="utf-8")):
                (self.path.parent / unescape(name)).unlink(missing_ok=True)

    def write(self, number: int, moment: Moment) -> None:
        """Write one frame. Raises InputError where a file cannot be written."""
        with system_errors(self.folder):
            self.folder.mkdir(exist_ok=True)
        for part, (name, content) in enumerate(_parts(self.animation, moment)):
            file = self.folder / f"{name}_{number:04d}.vtp"
            write_bytes(file, content)
            relative = quoteattr(f"{self.folder.name}/{file.name}")
            self._entries.append(
                f'    <DataSet timestep="{moment.time:.9g}" part="{part}" name="{name}" file={relative}/>\n'
            )
        write_text(
            self.path,
            '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n'
            "  <Collection>\n" + "".join(self._entries) + "  </Collection>\n</VTKFile>\n",
        )


def _parts(animation: Animation, moment: Moment) -> Iterator[tuple[str, bytes]]:
    import pyvista as pv

    if animation.cloth is not None and moment.cloth is not None:
        cloth = animation.cloth
        mesh = pv.PolyData.from_regular_faces(moment.cloth, cloth.triangles)
        mesh.point_data["Normals"] = vertex_normals(moment.cloth, cloth.triangles)
        if moment.velocities is not None:
            mesh.point_data["Velocity"] = moment.velocities
        if cloth.material is not None and not cloth.sewn:
            mesh.point_data["MaterialCoordinates"] = cloth.material
        yield "cloth", _content(mesh)
    if animation.bodies is not None and moment.bodies is not None:
        yield "bodies", _content(pv.PolyData.from_regular_faces(moment.bodies, animation.bodies.triangles))
    if animation.yarns is not None and moment.yarns is not None:
        curves = animation.yarns
        lengths = np.diff(curves.offsets)
        loops = [
            np.concatenate([[n + closed], np.arange(start, start + n), [start] * closed])
            for n, start, closed in zip(lengths, curves.offsets, curves.closed.astype(int), strict=False)
        ]
        lines = pv.PolyData(moment.yarns, lines=np.concatenate(loops).astype(np.int64))
        lines.point_data["Radius"] = curves.radii if moment.radii is None else moment.radii
        lines.cell_data["Yarn"], lines.cell_data["Curve"] = curves.yarn, np.arange(len(curves))
        yield "yarns", _content(lines)


def _content(mesh: object) -> bytes:
    """A .vtp file of the mesh, made in memory: on a full disk VTK's writer of files crashes."""
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    writer = vtkXMLPolyDataWriter()
    writer.WriteToOutputStringOn()
    writer.SetInputData(mesh)  # type: ignore[arg-type]
    writer.SetDataModeToBinary()
    writer.Write()
    return writer.GetOutputString().encode()

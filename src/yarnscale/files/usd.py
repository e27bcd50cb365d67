"""USD: cloth and bodies as animated meshes, yarns as animated BasisCurves, in one .usd, .usdc or .usda file."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError
from yarnscale.files.animation import Animation, Moment, Surface, vertex_normals
from yarnscale.files.atomic import replacement
from yarnscale.files.colours import colour_of, linear_yarn_colour
from yarnscale.files.curve_frames import CurveSet

_FRAMES_IN_MEMORY = 32


def write_usd(
    path: str | os.PathLike[str],
    animation: Animation,
    *,
    fps: float = 30.0,
    on_frame: Callable[[int], None] | None = None,
) -> None:
    """Write an animation, metres, z up; frames are read one by one.

    A frame of time t [s] is the time sample t · fps; between samples USD interpolates. The cloth has normals,
    velocities [m/s] and material coordinates [m] as ``primvars:st``. Yarns are cubic Catmull-Rom curves through
    their points, pinned at open ends and periodic where closed (two prims, as a prim is either);
    widths are diameters [m]. on_frame: called with the number of frames done.

    Raises InputError without the extra ``export`` or where the file cannot be written.
    """
    _, Tf, Usd, _, _ = _libraries()
    with replacement(path) as temporary:
        try:
            _fill(Usd.Stage.CreateNew(str(temporary)), animation, fps, on_frame)
        except Tf.ErrorException as error:
            # The first line of a USD error ends with what happened, in quotes.
            reason = str(error).strip().splitlines()[0].rsplit(" : ", 1)[-1].strip(" '")
            raise InputError("output cannot be written", where=path, found=reason) from None


def _fill(stage: Any, animation: Animation, fps: float, on_frame: Callable[[int], None] | None) -> None:
    Sdf, _, _, UsdGeom, _ = _libraries()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    stage.SetTimeCodesPerSecond(fps)
    stage.SetFramesPerSecond(fps)
    stage.SetStartTimeCode(float(animation.times[0] * fps))
    stage.SetEndTimeCode(float(animation.times[-1] * fps))
    root = UsdGeom.Xform.Define(stage, "/yarnscale")
    stage.SetDefaultPrim(root.GetPrim())
    parts = _Parts(stage, animation)
    for k, moment in enumerate(animation):
        with Sdf.ChangeBlock():
            parts.write(moment, moment.time * fps)
        if (k + 1) % _FRAMES_IN_MEMORY == 0:
            stage.Save()
        if on_frame is not None:
            on_frame(k + 1)
    stage.Save()


def _libraries() -> tuple[Any, ...]:
    try:
        from pxr import Sdf, Tf, Usd, UsdGeom, Vt
    except ImportError:
        raise InputError(
            "USD files need the package usd-core", expected="pip install 'yarnscale[export]'", found="none"
        ) from None
    return Sdf, Tf, Usd, UsdGeom, Vt


class _Parts:
    """The prims of a stage; ``write`` adds the samples of a moment."""

    def __init__(self, stage: Any, animation: Animation) -> None:
        self.sdf, _, _, self.geometry, self.arrays = _libraries()
        surfaces = {"cloth": animation.cloth, "bodies": animation.bodies}
        self.meshes = {name: (s, self._mesh(stage, name, s)) for name, s in surfaces.items() if s is not None}
        if "cloth" in self.meshes and animation.yarns is not None:
            # The yarns are the cloth; a hidden prim can be shown again.
            self.meshes["cloth"][1].MakeInvisible()
        self.curves: list[tuple[Any, Integers]] = []
        if animation.yarns is not None:
            closed = animation.yarns.closed
            for name, which in (("yarns", ~closed), ("loops", closed)):
                if which.any():
                    part, points = animation.yarns.chosen(which)
                    self.curves.append((self._basis_curves(stage, name, part), points))

    def write(self, moment: Moment, code: float) -> None:
        for name, (surface, prim) in self.meshes.items():
            if (positions := getattr(moment, name)) is not None:
                prim.GetPointsAttr().Set(self._vectors(positions), code)
                prim.GetNormalsAttr().Set(self._vectors(vertex_normals(positions, surface.triangles)), code)
                prim.GetExtentAttr().Set(self._vectors(_box(positions)), code)
        if "cloth" in self.meshes and moment.velocities is not None:
            self.meshes["cloth"][1].GetVelocitiesAttr().Set(self._vectors(moment.velocities), code)
        if moment.yarns is not None and moment.radii is not None:
            for prim, points in self.curves:
                places, radii = moment.yarns[points], moment.radii[points]
                prim.GetPointsAttr().Set(self._vectors(places), code)
                widths = np.ascontiguousarray(2.0 * radii, dtype=np.float32)
                prim.GetWidthsAttr().Set(self.arrays.FloatArray.FromNumpy(widths), code)
                prim.GetExtentAttr().Set(self._vectors(_box(places, float(radii.max()))), code)

    def _mesh(self, stage: Any, name: str, surface: Surface) -> Any:
        prim = self.geometry.Mesh.Define(stage, f"/yarnscale/{name}")
        triangles = np.ascontiguousarray(surface.triangles, dtype=np.int32)
        prim.CreateFaceVertexCountsAttr(self._integers(np.full(len(triangles), 3)))
        prim.CreateFaceVertexIndicesAttr(self._integers(triangles.ravel()))
        prim.CreateSubdivisionSchemeAttr(self.geometry.Tokens.none)
        prim.CreateDoubleSidedAttr(True)
        prim.SetNormalsInterpolation(self.geometry.Tokens.vertex)
        colour = np.array([colour_of(name)], dtype=np.float32)
        prim.CreateDisplayColorAttr(self.arrays.Vec3fArray.FromNumpy(colour))
        if surface.material is not None:
            per_corner = surface.sewn and surface.corners is not None
            how = self.geometry.Tokens.faceVarying if per_corner else self.geometry.Tokens.vertex
            kind = self.sdf.ValueTypeNames.TexCoord2fArray
            variable = self.geometry.PrimvarsAPI(prim).CreatePrimvar("st", kind, how)
            variable.Set(self.arrays.Vec2fArray.FromNumpy(surface.material.astype(np.float32)))
            if per_corner:
                variable.SetIndices(self._integers(np.asarray(surface.corners).ravel()))
        return prim

    def _basis_curves(self, stage: Any, name: str, curves: CurveSet) -> Any:
        tokens = self.geometry.Tokens
        prim = self.geometry.BasisCurves.Define(stage, f"/yarnscale/{name}")
        prim.CreateTypeAttr(tokens.cubic)
        prim.CreateBasisAttr(tokens.catmullRom)
        # Pinned curves reach their ends.
        prim.CreateWrapAttr(tokens.periodic if curves.closed[0] else tokens.pinned)
        prim.CreateCurveVertexCountsAttr(self._integers(np.diff(curves.offsets)))
        prim.SetWidthsInterpolation(tokens.vertex)
        colours = np.array([linear_yarn_colour(number) for number in curves.yarn.tolist()], dtype=np.float32)
        variable = prim.CreateDisplayColorPrimvar(tokens.uniform)
        variable.Set(self.arrays.Vec3fArray.FromNumpy(colours))
        return prim

    def _vectors(self, values: Array) -> Any:
        return self.arrays.Vec3fArray.FromNumpy(np.ascontiguousarray(values, dtype=np.float32))

    def _integers(self, values: NDArray) -> Any:
        return self.arrays.IntArray.FromNumpy(np.ascontiguousarray(values, dtype=np.int32))


def _box(points: Array, margin: float = 0.0) -> Array:
    """Corners of the box about points, (2, 3)."""
    return np.stack([points.min(axis=0) - margin, points.max(axis=0) + margin])

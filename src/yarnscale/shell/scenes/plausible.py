"""Checks of sizes, weights and loads of a cloth: unlikely values are reported, impossible ones refused."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.kinematics import GRAVITY, INCH
from yarnscale.motion.obstacles import Obstacle, Plane, Sphere
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.garments.polygons import extent
from yarnscale.shell.mesh import TriangleMesh

_COMMON_SIZE, _POSSIBLE_SIZE = (0.02, 5.0), (0.002, 20.0)
"""Largest extent of a cloth [m]: reported outside the first, refused outside the second unless its unit is stated."""
_COMMON_DENSITY, _LARGEST_DENSITY = (0.01, 3.0), 50.0
"""Mass per area [kg/m²]: textiles have 0.02 to 1, 6 mm of steel 47."""
_THICK_EDGES, _THICKEST_EDGES, _THICKEST_SHARE = 0.5, 10.0, 0.5
"""Thickness over the median edge, and over the smaller extent of the fabric."""
_MANY_GRAVITIES, _MOST_GRAVITIES = 10.0, 500.0
_LONG_WAY, _LONGEST_WAY, _FAR_APART = 20.0, 100.0, 5.0
"""Displacements of handles and bodies over the size of what they move."""
_FAST = 50.0
"""Mean speed of a handle or body [m/s]."""
_PRESSING = 1e4
"""Contact pressure over the weight of the cloth per area: 10 to 500 are common."""
_LARGE_BODY, _LARGEST_BODY = 50.0, 1000.0
"""Size of a body over that of the cloth, or the other way round."""


def sizes_line(cloth: Cloth) -> str:
    """One line: sizes [cm] and area of the fabric and of the cloth in space, and mass."""
    mesh = cloth.mesh
    mass = float(mesh.areas.sum()) * cloth.material.density
    return (
        f"fabric {extent(mesh.panel)}, {1e4 * mesh.areas.sum():.4g} cm²; in space {extent(mesh.assembled)}, "
        f"{1e4 * _area(mesh):.4g} cm²; {1e3 * mass:.4g} g"
    )


def size_notices(mesh: TriangleMesh, density: float) -> Iterator[str]:
    """Sentences about unlikely sizes; InputError for a size that must be in another unit."""
    size = float(max(np.ptp(mesh.panel, axis=0).max(), np.ptp(mesh.assembled, axis=0).max()))
    low, high = _POSSIBLE_SIZE
    found = f"{extent(mesh.panel)} and {mesh.areas.sum() * density:.3g} kg"
    fitting = " or ".join(u for u, m in (("cm", 0.01), ("mm", 0.001), ("inch", INCH)) if 0.05 < m * size < 5)
    fits = f" (lengths in {fitting} would be common)" if fitting else ""
    if not low <= size <= high:
        raise InputError(
            "size of the fabric", expected=f"{low:g} to {high:g} m, or unit = \"m\" where it is meant{fits}",
            found=found,
        )  # fmt: skip
    if not _COMMON_SIZE[0] <= size <= _COMMON_SIZE[1]:
        yield f"the cloth is of an unusual size: {found}{fits}"


def cloth_notices(cloth: Cloth) -> Iterator[str]:
    """Sentences about unlikely mass, thickness and loads; InputError for impossible ones."""
    density = cloth.material.density
    if density > _LARGEST_DENSITY:
        raise InputError("density of the material", expected=f"at most {_LARGEST_DENSITY:g} kg/m²", found=density)
    if not _COMMON_DENSITY[0] <= density <= _COMMON_DENSITY[1]:
        yield f"the density of the material is unusual: {density:g} kg/m² ({1e3 * density:g} g/m²)"
    yield from _thickness(cloth)
    pull = float(np.linalg.norm(cloth.gravity)) / GRAVITY
    if pull > _MOST_GRAVITIES:
        raise InputError("gravity", expected=f"at most {_MOST_GRAVITIES:g} times 9.81 m/s²", found=cloth.gravity)
    if pull > _MANY_GRAVITIES:
        yield f"gravity is {pull:.3g} times that of the earth"
    weight = density * GRAVITY * pull
    if cloth.contact is not None and weight > 0 and cloth.contact.pressure > _PRESSING * weight:
        times = cloth.contact.pressure / weight
        yield f"contact presses with {cloth.contact.pressure:g} Pa, {times:.3g} times the weight of the cloth per area"
    yield from _ways(cloth)
    for body in cloth.obstacles:
        yield from _body(body, _size(cloth.mesh.assembled))


def _thickness(cloth: Cloth) -> Iterator[str]:
    if cloth.contact is None:
        return
    mesh, thickness = cloth.mesh, cloth.contact.thickness
    edge = mesh.median_edge
    width = float(np.ptp(mesh.panel, axis=0).min())
    if thickness > _THICKEST_EDGES * edge or thickness > _THICKEST_SHARE * width:
        raise InputError(
            "thickness of the contact",
            expected=f"a small part of the fabric, {100 * width:.3g} cm wide with edges of {1e3 * edge:.3g} mm",
            found=f"{1e3 * thickness:.4g} mm",
        )
    if thickness > _THICK_EDGES * edge and cloth.contact.self_contact:
        yield (
            f"contact is {1e3 * thickness:.3g} mm thick and edges of the mesh are {1e3 * edge:.3g} mm long: "
            "the cloth repels itself while it lies flat"
        )


def _ways(cloth: Cloth) -> Iterator[str]:
    size = _size(cloth.mesh.assembled)
    moving = [(f"handle '{handle.name}'", handle.motion, size) for handle in cloth.handles]
    for body in cloth.obstacles:
        motion = getattr(body, "motion", None)
        if motion is not None and not isinstance(body, Plane):
            moving.append(("an obstacle", motion, max(size, _size(body.points(0.0)))))
    for name, motion, reach in moving:
        travel = math.sqrt(sum(d * d for d in motion.displacement))
        times = travel / reach
        if times > _LONGEST_WAY:
            expected = f"at most {_LONGEST_WAY:g} times its size, {100 * reach:.3g} cm"
            raise InputError(f"displacement of {name}", expected=expected, found=motion.displacement)
        if times > _LONG_WAY:
            yield f"{name} moves by {times:.3g} times its size, {100 * reach:.3g} cm"
        if motion.duration > 0 and travel / motion.duration > _FAST:
            yield f"{name} moves at {travel / motion.duration:.3g} m/s"
    moved = np.array([handle.motion.displacement for handle in cloth.handles]).reshape(-1, 3)
    apart = float(np.ptp(moved, axis=0).max()) / size if len(moved) > 1 else 0.0
    if apart > _FAR_APART:
        yield f"handles move against each other by {apart:.3g} times the size of the cloth, {100 * size:.3g} cm"


def _body(body: Obstacle, cloth: float) -> Iterator[str]:
    if isinstance(body, Plane):
        return
    size = 2 * body.radius if isinstance(body, Sphere) else _size(body.points(0.0))
    times = size / cloth
    found = f"{100 * size:.4g} cm beside a cloth of {100 * cloth:.4g} cm"
    if max(times, 1 / max(times, 1e-300)) > _LARGEST_BODY:
        expected = "one of a size with the cloth; lengths of an obstacle may need a scale"
        raise InputError("obstacle", expected=expected, found=found)
    if not 1 / _LARGE_BODY <= times <= _LARGE_BODY:
        yield f"an obstacle is of another size than the cloth: {found}"


def _size(points: Array) -> float:
    return max(float(np.ptp(points, axis=0).max()), 1e-12)


def _area(mesh: TriangleMesh) -> float:
    x = mesh.assembled[mesh.triangles]
    return 0.5 * float(np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1).sum())

"""Obstacles of a scene file: balls, planes, meshes that move as a whole or frame by frame, and the mannequin."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np

from yarnscale.errors import InputError
from yarnscale.files.garment_units import LENGTHS
from yarnscale.files.obj_surface import read_obj_poses, read_obj_surface
from yarnscale.files.scene_section import MOTION, SceneTable
from yarnscale.motion.obstacles import AnimatedMesh, MeshObstacle, Obstacle, Plane, Sphere
from yarnscale.shell.garments.mannequin import MovingMannequin, Pose, mannequin

SHAPES = ("sphere", "plane", "mesh", "mannequin")


def read_obstacle(section: SceneTable) -> Obstacle:
    """The obstacle that a table [[obstacles]] describes. Raises InputError."""
    shape = section.choice_or("shape", "", SHAPES)
    if shape == "sphere":
        section.known("shape", "centre", "radius", *MOTION)
        motion = section.motion()
        return section.build(lambda: Sphere(section.vector("centre"), section.number("radius"), motion))
    if shape == "plane":
        section.known("shape", "point", "normal", "displacement", "start", "duration", "ease")
        point, motion = section.vector_or("point", (0.0, 0.0, 0.0)), section.motion()
        return section.build(lambda: Plane(point, section.vector_or("normal", (0.0, 0.0, 1.0)), motion))
    if shape == "mannequin":
        return _mannequin(section)
    if "unit" in section.content and "scale" in section.content:
        raise section.fault("unit", expected="none beside 'scale'")
    metres = LENGTHS[section.choice_or("unit", "m", tuple(LENGTHS))]
    scale = section.number("scale", positive=True) if "scale" in section.content else metres
    position = np.array(section.vector_or("position", (0.0, 0.0, 0.0)))
    if "frames" in section.content:
        return _animated(section, scale, position)
    section.known("shape", "file", "unit", "scale", "position", *MOTION)
    vertices, triangles = read_obj_surface(section.beside(section.text("file")))
    motion = section.motion()
    return section.build(lambda: MeshObstacle(scale * vertices + position, triangles, motion))


def _animated(section: SceneTable, scale: float, position: np.ndarray) -> AnimatedMesh:
    """``frames`` is a file name with a star for the frame numbers; files are taken in the order of these."""
    section.known("shape", "frames", "frame_rate", "start", "unit", "scale", "position")
    pattern = section.text("frames")
    rate = section.number("frame_rate", positive=True)
    folder, name = Path(section.path).parent / Path(pattern).parent, Path(pattern).name
    if name.count("*") != 1:
        raise section.fault("frames", expected="a file name with one star, as in body_*.obj", found=pattern)
    before, after = name.split("*")
    form = re.compile(re.escape(before) + r"(\d+)" + re.escape(after))
    found = [(int(match[1]), path) for path in folder.glob(name) if (match := form.fullmatch(path.name))]
    if not found:
        raise section.fault("frames", expected="files with numbers in place of the star", found="none")
    found.sort()
    poses, triangles = read_obj_poses([path for _, path in found])
    numbers = np.array([number for number, _ in found])
    times = section.number_or("start", 0.0) + (numbers - numbers[0]) / rate
    return section.build(lambda: AnimatedMesh(times, scale * poses + position, triangles))


def _mannequin(section: SceneTable) -> MovingMannequin:
    section.known("shape", "spacing", "poses")
    poses = []
    for item in section.items("poses", optional=True):
        item.known("time", "lowered", "turned", "depth")
        depth = item.number_or("depth", 1.0)
        if not 0.05 <= depth <= 1.5:
            raise InputError(f"field '{item.label('depth')}'", where=section.path, expected="0.05 to 1.5", found=depth)
        lowered, turned = (math.radians(item.number_or(key, 0.0)) for key in ("lowered", "turned"))
        poses.append(Pose(item.number("time"), lowered, turned, depth))
    body = section.build(lambda: mannequin(section.number_or("spacing", 0.02)))
    return section.build(lambda: MovingMannequin(body, tuple(poses) or (Pose(0.0),)))

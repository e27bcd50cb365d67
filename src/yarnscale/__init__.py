"""Knitted and woven cloth across scales: from the yarn, through the periodic cell, to the garment.

The public names below load the room that defines them on first use (PEP 562), so that
``import yarnscale`` itself costs a few milliseconds.
"""

from __future__ import annotations

import importlib
import sys
from typing import TYPE_CHECKING

from yarnscale.version import __version__

if TYPE_CHECKING:
    from yarnscale.cell.equilibrium import Equilibrium
    from yarnscale.cell.friction import CellHistory
    from yarnscale.cell.periodic import PeriodicCell
    from yarnscale.cell.rest import RestShape, settled
    from yarnscale.detail.fluctuations import FluctuationTable
    from yarnscale.detail.yarns import YarnDetail
    from yarnscale.drawing import library as patterns
    from yarnscale.drawing.knit import knit
    from yarnscale.drawing.weave import weave
    from yarnscale.errors import InputError
    from yarnscale.fabric import sheet_scene as sheet_scenes
    from yarnscale.fabric.fabric_scene import FabricResult
    from yarnscale.fabric.rod_fabric import RodFabric
    from yarnscale.fabric.rod_scene import RodScene
    from yarnscale.fabric.sheet import YarnSheet
    from yarnscale.fabric.spline_knit import SplineFabric, jersey, spline_fabric
    from yarnscale.fabric.spline_scene import SplineScene
    from yarnscale.fabric.volume import BoundingVolume
    from yarnscale.files import material_library
    from yarnscale.files.estimate_run import estimate, fabric_model
    from yarnscale.files.grid_toml import read_grid
    from yarnscale.files.material_json import read_material, write_material
    from yarnscale.files.material_toml import read_yarn_material, write_yarn_material
    from yarnscale.files.measurements import read_measurements
    from yarnscale.files.patterns import read_pattern, read_yarns, structure_of, write_pattern
    from yarnscale.files.scene_run import run
    from yarnscale.homogeneous.histories import path_with_friction
    from yarnscale.homogenize.compact_fit import fit_compact_material
    from yarnscale.homogenize.homogenize import Homogenization, fit, fit_published
    from yarnscale.homogenize.homogenize import homogenize as homogenize_cell
    from yarnscale.homogenize.plan import StrainGrid, StrainRange, axes_and_planes
    from yarnscale.homogenize.published_fit import fit_spline_material
    from yarnscale.homogenize.sample import create_store, sample
    from yarnscale.homogenize.store import SampleStore
    from yarnscale.kinematics import COMPONENTS, ShellStrain
    from yarnscale.laboratory.programme import FabricTests, Programme, run_tests
    from yarnscale.motion.run import simulate
    from yarnscale.motion.schedule import Schedule
    from yarnscale.numerics.newton import Status
    from yarnscale.shell import scenes
    from yarnscale.shell.dynamics.cloth import Cloth
    from yarnscale.shell.materials.compact import CompactMaterial
    from yarnscale.shell.materials.material import ShellMaterial
    from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
    from yarnscale.shell.materials.spline_material import SplineMaterial
    from yarnscale.shell.materials.stiffening import StiffeningMaterial
    from yarnscale.shell.mesh import TriangleMesh
    from yarnscale.shell.scenes.scene import Scene
    from yarnscale.swatches.fabric_shell import FabricShell, fit_shell
    from yarnscale.swatches.measurements import SwatchMeasurements
    from yarnscale.swatches.yarn_estimate import FabricEstimate
    from yarnscale.yarn.friction import YarnFriction
    from yarnscale.yarn.material import ContactRule, StretchRule, YarnMaterial
    from yarnscale.yarn.pattern import YarnPattern

_HOME = {
    "BoundingVolume": "fabric.volume",
    "COMPONENTS": "kinematics",
    "CellHistory": "cell.friction",
    "Cloth": "shell.dynamics.cloth",
    "CompactMaterial": "shell.materials.compact",
    "ContactRule": "yarn.material",
    "Equilibrium": "cell.equilibrium",
    "FabricEstimate": "swatches.yarn_estimate",
    "FabricResult": "fabric.fabric_scene",
    "FabricShell": "swatches.fabric_shell",
    "FabricTests": "laboratory.programme",
    "FluctuationTable": "detail.fluctuations",
    "Homogenization": "homogenize.homogenize",
    "InputError": "errors",
    "OrthotropicMaterial": "shell.materials.orthotropic",
    "PeriodicCell": "cell.periodic",
    "Programme": "laboratory.programme",
    "RestShape": "cell.rest",
    "RodFabric": "fabric.rod_fabric",
    "RodScene": "fabric.rod_scene",
    "SampleStore": "homogenize.store",
    "Scene": "shell.scenes.scene",
    "Schedule": "motion.schedule",
    "ShellMaterial": "shell.materials.material",
    "ShellStrain": "kinematics",
    "SplineFabric": "fabric.spline_knit",
    "SplineMaterial": "shell.materials.spline_material",
    "SplineScene": "fabric.spline_scene",
    "Status": "numerics.newton",
    "StiffeningMaterial": "shell.materials.stiffening",
    "StrainGrid": "homogenize.plan",
    "StrainRange": "homogenize.plan",
    "StretchRule": "yarn.material",
    "SwatchMeasurements": "swatches.measurements",
    "TriangleMesh": "shell.mesh",
    "YarnDetail": "detail.yarns",
    "YarnFriction": "yarn.friction",
    "YarnMaterial": "yarn.material",
    "YarnPattern": "yarn.pattern",
    "YarnSheet": "fabric.sheet",
    "axes_and_planes": "homogenize.plan",
    "create_store": "homogenize.sample",
    "estimate": "files.estimate_run",
    "fabric_model": "files.estimate_run",
    "fit": "homogenize.homogenize",
    "fit_compact_material": "homogenize.compact_fit",
    "fit_published": "homogenize.homogenize",
    "fit_shell": "swatches.fabric_shell",
    "fit_spline_material": "homogenize.published_fit",
    "homogenize_cell": "homogenize.homogenize:homogenize",
    "jersey": "fabric.spline_knit",
    "knit": "drawing.knit",
    "material_library": "files.material_library:",
    "path_with_friction": "homogeneous.histories",
    "patterns": "drawing.library:",
    "read_grid": "files.grid_toml",
    "read_material": "files.material_json",
    "read_measurements": "files.measurements",
    "read_pattern": "files.patterns",
    "read_yarn_material": "files.material_toml",
    "read_yarns": "files.patterns",
    "run": "files.scene_run",
    "run_tests": "laboratory.programme",
    "sample": "homogenize.sample",
    "scenes": "shell.scenes:",
    "settled": "cell.rest",
    "sheet_scenes": "fabric.sheet_scene:",
    "simulate": "motion.run",
    "spline_fabric": "fabric.spline_knit",
    "structure_of": "files.patterns",
    "weave": "drawing.weave",
    "write_material": "files.material_json",
    "write_pattern": "files.patterns",
    "write_yarn_material": "files.material_toml",
}
"""Public name -> module that defines it, with ``:name`` where it is called otherwise there and ``:`` for the
module itself. The imports above say the same to type checkers."""

__all__ = [  # noqa: RUF022
    "BoundingVolume", "COMPONENTS", "CellHistory", "Cloth", "CompactMaterial", "ContactRule", "Equilibrium",
    "FabricEstimate", "FabricResult", "FabricShell", "FabricTests", "FluctuationTable", "Homogenization", "InputError",
    "OrthotropicMaterial", "PeriodicCell", "Programme", "RestShape", "RodFabric", "RodScene", "SampleStore", "Scene",
    "Schedule", "ShellMaterial", "ShellStrain", "SplineFabric", "SplineMaterial", "SplineScene", "Status",
    "StiffeningMaterial", "StrainGrid", "StrainRange", "StretchRule", "SwatchMeasurements",
    "TriangleMesh", "YarnDetail", "YarnFriction", "YarnMaterial",
    "YarnPattern", "YarnSheet", "__version__", "axes_and_planes", "create_store", "estimate", "fabric_model",
    "fit", "fit_compact_material", "fit_published", "fit_shell", "fit_spline_material", "homogenize_cell", "jersey",
    "knit", "material_library", "path_with_friction", "patterns", "read_grid", "read_material", "read_measurements",
    "read_pattern", "read_yarn_material", "read_yarns", "run", "run_tests", "sample", "scenes", "settled",
    "sheet_scenes", "simulate", "spline_fabric", "structure_of", "weave", "write_material",
    "write_pattern", "write_yarn_material",
]  # fmt: skip

_SHOWN = {
    "Equilibrium": "cell.equilibrium",
    "FabricEstimate": "swatches.yarn_estimate",
    "PeriodicCell": "cell.periodic",
    "ShellMaterial": "shell.materials.material",
    "SimulatedOutcome": "motion.scene",
    "YarnPattern": "yarn.pattern",
}
"""Classes that notebooks show with ``show.notebook``, and where they are."""


def _show_in_notebooks() -> None:
    """Tell the notebook that runs, if one does, how to show them."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    if shell is not None:
        pages = shell.display_formatter.formatters["text/html"]
        for name, room in _SHOWN.items():
            pages.for_type_by_name(f"yarnscale.{room}", name, _html)


def _html(thing: object) -> str:
    return importlib.import_module("yarnscale.show.notebook").html_of(thing)


def __getattr__(name: str) -> object:
    """Load a public name from its module on first use."""
    if name not in _HOME:
        raise AttributeError(f"module 'yarnscale' has no attribute {name!r}")
    room, renamed, other = _HOME[name].partition(":")
    module = importlib.import_module(f"yarnscale.{room}")
    value = module if renamed and not other else getattr(module, other or name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__


_show_in_notebooks()

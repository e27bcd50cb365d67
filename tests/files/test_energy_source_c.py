"""The C source of a material: compiled with the system's compiler, it agrees with the material."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from yarnscale.files.energy_source import energy_source, write_energy_source
from yarnscale.shell.materials.compact import CompactMaterial

COMPILER = shutil.which("cc") or shutil.which("gcc")
Six, Square = ctypes.c_double * 6, ctypes.c_double * 36


def compiled(folder, ours: CompactMaterial):
    """The function ``yarnscale_energy`` of a shared library built without warnings."""
    if COMPILER is None:
        pytest.skip("no C compiler (cc or gcc) on this machine")
    source, library = folder / "material.c", folder / "material.so"
    write_energy_source(source, ours, "c")
    flags = ["-std=c99", "-O1", "-Wall", "-Wextra", "-Werror", "-pedantic", "-shared", "-fPIC"]
    outcome = subprocess.run(
        [COMPILER, *flags, str(source), "-o", str(library), "-lm"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert outcome.returncode == 0, outcome.stderr[:2000]
    return ctypes.CDLL(str(library)).yarnscale_energy


def evaluate(function, strain: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    energy, gradient, hessian = ctypes.c_double(), Six(), Square()
    assert function(Six(*strain), ctypes.byref(energy), gradient, hessian) == 0
    return energy.value, np.array(gradient), np.array(hessian).reshape(6, 6)


def check(function, ours: CompactMaterial, strains: np.ndarray) -> None:
    found = [evaluate(function, strain) for strain in strains]
    for k, name in enumerate(("energy_density", "stress", "moduli")):
        expected = getattr(ours, name)(strains)
        ours_now = np.array([values[k] for values in found])
        # Each component against its own largest value: curvatures have other units than strains.
        size = np.max(np.abs(expected), axis=0)
        assert np.max(np.abs(ours_now - expected) / size) < 1e-12


@pytest.mark.parametrize("mirrored", [True, False])
def test_the_compiled_source_agrees(tmp_path, compact, states, mirrored):
    material = replace(compact, mirrored=mirrored)
    strains = states(1.2, 100)
    strains[-1] = 0.0
    check(compiled(tmp_path, material), material, strains)


def test_outputs_may_be_missing_and_impossible_strains_are_refused(tmp_path, compact):
    material = compact
    function = compiled(tmp_path, material)
    energy = ctypes.c_double(-7.0)
    assert function(Six(), ctypes.byref(energy), None, None) == 0
    assert energy.value == pytest.approx(float(material.energy_density(np.zeros(6))), rel=1e-14)
    energy.value = -7.0
    for place, bad in ((0, -1.0), (1, 1.0), (2, np.nan), (3, np.inf)):
        strain = np.zeros(6)
        strain[place] = bad
        assert function(Six(*strain), ctypes.byref(energy), None, None) == 1
    assert energy.value == -7.0


def test_a_name_cannot_break_the_comment(compact):
    named = replace(compact, provenance={"pattern": "a */ int x; /*\n#error"})
    assert energy_source(named, "c").count("*/") == energy_source(compact, "c").count("*/")
    assert "\n#error" not in energy_source(named, "c")

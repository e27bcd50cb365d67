"""The front door opens fast: heavy modules load only when they are used."""

from __future__ import annotations

import subprocess
import sys

import pytest

import yarnscale

HEAVY = (
    "pyvista",
    "vtkmodules",
    "matplotlib",
    "xarray",
    "zarr",
    "ipctk",
    "numba",
    "llvmlite",
    "casadi",
    "scipy",
    "jinja2",
    "distributed",
    "cvxopt",
)


def heavy_modules_after(code: str) -> list[str]:
    """Names of heavy modules that a fresh interpreter has loaded after running ``code``."""
    probe = f"import sys\n{code}\nprint(*[m for m in {HEAVY!r} if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True)
    return run.stdout.splitlines()[-1].split()


def test_import_loads_no_heavy_module() -> None:
    assert heavy_modules_after("import yarnscale; yarnscale.__version__; dir(yarnscale)") == []


def test_light_names_load_no_heavy_module() -> None:
    assert heavy_modules_after("import yarnscale; yarnscale.ShellStrain(s_x=0.1)") == []


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = yarnscale.nonsense  # type: ignore[attr-defined]


def test_names_are_cached_after_first_use() -> None:
    assert yarnscale.ShellStrain is yarnscale.ShellStrain
    assert "ShellStrain" in vars(yarnscale)


@pytest.mark.parametrize("name", sorted(yarnscale.__all__))
def test_every_public_name_exists(name: str) -> None:
    assert getattr(yarnscale, name) is not None

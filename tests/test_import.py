"""The front door opens fast: heavy modules load only when they are used."""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import yarnscale

HEAVY = (
    "pyvista",
    "vtkmodules",
    "matplotlib",
    "xarray",
    "zarr",
    "numba",
    "llvmlite",
    "casadi",
    "scipy",
    "jinja2",
    "distributed",
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


def test_help_loads_no_heavy_module() -> None:
    imports = "import contextlib, yarnscale.cli"
    call = "with contextlib.suppress(SystemExit): yarnscale.cli.main(['--help'])"
    assert heavy_modules_after(f"{imports}\n{call}") == []


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = yarnscale.nonsense  # type: ignore[attr-defined]


def test_names_are_cached_after_first_use() -> None:
    assert yarnscale.ShellStrain is yarnscale.ShellStrain
    assert "ShellStrain" in vars(yarnscale)


def test_type_checkers_are_told_the_same() -> None:
    tree = ast.parse(Path(yarnscale.__file__).read_text(encoding="utf-8"))
    told = {
        alias.asname or alias.name: (node.module, alias.name)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("yarnscale")
        for alias in node.names
    }
    assert sorted(told) == sorted(yarnscale.__all__)
    for public, (module, name) in told.items():
        room = importlib.import_module(module or "")
        value = getattr(room, name, None) or importlib.import_module(f"{module}.{name}")
        assert getattr(yarnscale, public) is value


@pytest.mark.parametrize("name", sorted(yarnscale.__all__))
def test_every_public_name_exists(name: str) -> None:
    assert getattr(yarnscale, name) is not None

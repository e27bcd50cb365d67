"""Knitted and woven cloth across scales: from the yarn, through the periodic cell, to the garment.

The public names below load the room that defines them on first use (PEP 562), so that
``import yarnscale`` itself costs a few milliseconds.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from yarnscale.errors import InputError
    from yarnscale.kinematics import COMPONENTS, ShellStrain

_HOME = {
    "COMPONENTS": "yarnscale.kinematics",
    "InputError": "yarnscale.errors",
    "ShellStrain": "yarnscale.kinematics",
}
"""Public name -> module that defines it; the imports above say the same to type checkers."""

__all__ = ["COMPONENTS", "InputError", "ShellStrain", "__version__"]


def __getattr__(name: str) -> object:
    """Load a public name from its module on first use."""
    if name not in _HOME:
        raise AttributeError(f"module 'yarnscale' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

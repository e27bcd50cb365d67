"""Fixtures that every test may use."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def shared() -> Path:
    """The reference data folder; tests that need it are skipped where it is missing."""
    folder = Path(os.environ.get("YARNSCALE_SHARED") or REPOSITORY.parent / "shared")
    if not (folder / "reference").is_dir():
        pytest.skip(f"reference data folder not found: {folder} (set YARNSCALE_SHARED to its path)")
    return folder

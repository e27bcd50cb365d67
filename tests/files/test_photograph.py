"""Pictures as cameras write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from yarnscale.cli.register import _photographs
from yarnscale.errors import InputError
from yarnscale.files import photograph
from yarnscale.files.photograph import MOST_PIXELS, read_photograph


def test_pictures_are_upright_as_the_camera_says(tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (80, 120), np.uint8)
    turned = Image.Exif()
    turned[0x0112] = 6
    Image.fromarray(pixels).save(tmp_path / "turned.png", exif=turned)
    found = read_photograph(tmp_path / "turned.png")
    assert (found.brightness == np.rot90(pixels, -1)).all()


def test_pictures_are_reduced_alike(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(photograph, "LARGEST_SIDE", 200)
    files = {"front": tmp_path / "front.png", "back": tmp_path / "back.png"}
    for path, columns in zip(files.values(), (200, 202), strict=True):
        Image.fromarray(np.random.default_rng(0).integers(0, 255, (140, columns), np.uint8)).save(path)
    found = _photographs(files)
    assert [one.reduced for one in found.values()] == [2, 2]
    assert [one.brightness.shape for one in found.values()] == [(70, 100), (70, 101)]
    with pytest.raises(InputError, match="at least 192 pixels"):
        read_photograph(files["front"], reduced=3)


def test_sizes_up_to_the_limit_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "large.png"
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (100, 120), np.uint8)).save(path)
    # As a picture of 1.2 times what Pillow warns of; then one that it refuses itself.
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 10_000)
    assert read_photograph(path).brightness.shape == (100, 120)
    for name, value in (("MOST_PIXELS", 11_999), ("MOST_PIXELS", MOST_PIXELS)):
        monkeypatch.setattr(photograph, name, value)
        with pytest.raises(InputError, match=f"{value}"):
            read_photograph(path)
        monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 5_000)

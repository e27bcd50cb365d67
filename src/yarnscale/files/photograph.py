"""Photographs of fabrics: brightness and size of a pixel."""

from __future__ import annotations

import io
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps, UnidentifiedImageError

from yarnscale.errors import InputError

LARGEST_SIDE = 2400
"""Pixels of the longer side that are kept; larger pictures are reduced."""
SMALLEST_SIDE = 64
MOST_PIXELS = 150_000_000
"""Pillow warns from 90 million pixels and refuses from 180 million, which is above this."""
_SCREENS = (72.0, 96.0)
"""Resolutions [dpi] that programs write where they know none."""


@dataclass(frozen=True, eq=False)
class Photograph:
    """brightness: (rows, columns). reduced: pixels of the file for one of these. dpi: of the file, None if unknown."""

    path: Path
    brightness: NDArray[np.float64]
    reduced: int
    dpi: float | None

    def png(self) -> bytes:
        """The picture as it is used, from black to white, for a page."""
        content = io.BytesIO()
        low, high = np.percentile(self.brightness, (0.5, 99.5))
        shades = 255.0 * (self.brightness - low) / max(float(high - low), 1e-9)
        Image.fromarray(np.clip(shades, 0, 255).astype(np.uint8)).save(content, format="png")
        return content.getvalue()


def read_photograph(path: Path, *, reduced: int = 1) -> Photograph:
    """A picture file (PNG, JPEG, TIFF, …) in grey, upright as its camera says.

    reduced: pixels of the file for one that is kept, each way, at least.
    Raises InputError for files that are none, and too small or too large ones.
    """
    try:
        with warnings.catch_warnings():
            # The size is checked below, before anything is decoded.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(path) as picture:
                return _read(path, picture, reduced)
    except Image.DecompressionBombError:
        raise InputError("picture is too large", where=path, expected=f"≤ {MOST_PIXELS} pixels") from None
    except UnidentifiedImageError:
        raise InputError("file is no picture", where=path, expected="PNG, JPEG or TIFF") from None
    except (OSError, ValueError, SyntaxError, EOFError) as error:
        if isinstance(error, InputError):
            raise
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise InputError("picture cannot be read", where=path, found=reason) from None


def _read(path: Path, picture: Image.Image, reduced: int) -> Photograph:
    size = picture.width, picture.height
    if min(size) < SMALLEST_SIDE * reduced or size[0] * size[1] > MOST_PIXELS:
        expected = f"at least {SMALLEST_SIDE * reduced} pixels each way, ≤ {MOST_PIXELS} in all"
        raise InputError("size of the picture", where=path, expected=expected, found=f"{size[0]} × {size[1]}")
    dpi = picture.info.get("dpi")
    known = float(dpi[0]) if isinstance(dpi, tuple) and len(dpi) == 2 and dpi[0] == dpi[1] else None
    if known is not None and (known < 10.0 or round(known) in _SCREENS):
        known = None
    reduced = max(reduced, -(-max(size) // LARGEST_SIDE))
    brightness = _grey(ImageOps.exif_transpose(picture))
    if reduced > 1:
        rows, columns = (n // reduced for n in brightness.shape)
        blocks = brightness[: rows * reduced, : columns * reduced].reshape(rows, reduced, columns, reduced)
        brightness = blocks.mean(axis=(1, 3))
    if float(np.ptp(brightness)) < 1e-9:
        raise InputError("picture is of one brightness", where=path, expected="a photograph of a fabric")
    return Photograph(path, brightness, reduced, known)


def _grey(picture: Image.Image) -> NDArray[np.float64]:
    """Brightness from 0 to 255; of deeper files too."""
    if picture.mode in ("I", "F") or picture.mode.startswith("I;16"):
        values = np.asarray(picture, dtype=np.float64)
        low, high = float(values.min()), float(values.max())
        return 255.0 * (values - low) / max(high - low, 1e-300)
    return np.asarray(picture.convert("L"), dtype=np.float64)

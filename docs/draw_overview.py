"""Draw docs/pictures/overview.png from the demo's pictures: run ``make demo``, then this."""

from __future__ import annotations

from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
PARTS = (
    "demo/yarns/stretched_along_the_course.png",
    "demo/homogenized/pictures/plane_s_x_s_y.png",
    "demo/drape/last.png",
)
HEIGHT = 420


def main() -> None:
    """Yarns, fitted energy and cloth in one row."""
    pictures = [Image.open(ROOT / part).convert("RGB") for part in PARTS]
    pictures = [p.resize((round(p.width * HEIGHT / p.height), HEIGHT), Image.Resampling.LANCZOS) for p in pictures]
    sheet = Image.new("RGB", (sum(p.width for p in pictures), HEIGHT), "white")
    left = 0
    for picture in pictures:
        sheet.paste(picture, (left, 0))
        left += picture.width
    (ROOT / "docs" / "pictures").mkdir(exist_ok=True)
    sheet.save(ROOT / "docs" / "pictures" / "overview.png", optimize=True)


if __name__ == "__main__":
    main()

"""Take a folder of ``yarnscale library`` into the package: `python docs/make_library.py build/library`.

What the package keeps of a material: the shell material, the fabric at rest, and the tests with six digits.
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

from yarnscale.files.material_library import LIBRARY, MATERIAL, PATTERN, TESTS, names


def shortened(value: object) -> object:
    """The same with six significant digits in every number."""
    if isinstance(value, dict):
        return {key: shortened(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [shortened(entry) for entry in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value


def write(path: Path, value: object) -> None:
    """As one line of JSON."""
    path.write_text(json.dumps(value, separators=(",", ":")) + "\n", encoding="utf-8")


def main() -> None:
    """Copy all materials that were tested."""
    made = Path(sys.argv[1])
    for name in names(made):
        if not (made / name / TESTS).is_file():
            continue
        target = LIBRARY / name
        (target / TESTS).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(made / name / MATERIAL, target / MATERIAL)
        write(target / PATTERN, json.loads((made / name / PATTERN).read_text(encoding="utf-8")))
        tests = json.loads((made / name / TESTS).read_text(encoding="utf-8"))
        tests = {**tests, "subject": name, "against": {**tests["against"], "subject": name}}
        write(target / TESTS, shortened(tests))
        sizes = {path.name: path.stat().st_size for path in sorted(target.rglob("*.json"))}
        print(f"{name}: {', '.join(f'{file} {size / 1e3:.0f} kB' for file, size in sizes.items())}")


if __name__ == "__main__":
    main()

"""Run what README.md and the pages of docs say: `python docs/run_commands.py README.md docs/guide/fabric.md`.

Every command of a block and every block of Python is run in a folder that holds the samples, in the order of the page,
costly ones with the smaller numbers of ``SMALLER``. Pages that homogenize alike share the result. ``PARSED_ONLY`` are
only parsed.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
SMALLER: dict[str, list[str]] = {
    "samples": ["--overwrite"],
    "gallery": ["plain", "--as-drawn"],
    "homogenize": ["--solves", "30", "--workers", "1", "--overwrite"],
    "test": ["--directions", "0", "--loads", "1", "--curvatures", "5"],
    "stretch": ["--spacing", "0.03", "--duration", "0.1", "--overwrite"],
    "drape": ["--spacing", "0.03", "--overwrite"],
    "simulate hang": ["--spacing", "0.05", "--animation", "--overwrite"],
    "fabric": ["--rows", "3", "--columns", "3", "--duration", "0.005", "--overwrite"],
    "fabric jersey --rows 7 --columns 7 --method compare --scene imposed": [
        "--rows",
        "2",
        "--columns",
        "2",
        "--volume",
        "4,4,2",
        "--overwrite",
    ],
    "fabric stockinette --method direct --on": ["--duration", "0.002"],
    "convert": ["--frames", "0", "--overwrite"],
    "detail": ["--frames", "0"],
    "view": ["--as-drawn"],
}
"""Beginning of a command -> options that make it small; the longest beginning counts."""
PARSED_ONLY = {
    "register": "waits for a person, or takes photographs; tests/cli/test_register.py",
    "estimate": "minutes to hours; tests/cli/test_estimate.py",
    "library": "minutes for a material; tests/cli/test_library.py",
    "homogenize stockinette --friction": "minutes of cycles; tests/homogenize/test_friction_fit.py",
    "test m/material.json": "minutes of cycles; tests/laboratory/test_cycles.py",
    "test stockinette": "a minute of cells; tests/laboratory",
    "test knit/material.json --drape": "a minute of cloth; tests/laboratory/test_summary.py",
    "sample ": "minutes of cells; tests/cli/test_sample.py",
}
"""Beginning of a command that takes minutes whatever is made smaller -> why, and the tests of what it does."""
INSTEAD = {"simulate sweater": "simulate hang"}
"""Beginning of a command that takes minutes -> what is run in its place, so that the commands after it have a run."""
BEFORE = {
    "virtual_tests": ["yarnscale homogenize stockinette --out knit"],
    # What an estimate leaves: the fabric at rest, from one of its yarns, and that yarn.
    "engineer": [
        "yarnscale samples --out estimated",
        "yarnscale pattern stockinette --out estimated/pattern.json",
    ],
}
"""What a page takes as made."""


def blocks(page: Path) -> list[tuple[int, str, str]]:
    """Line, language and content of every block of a page."""
    text = page.read_text(encoding="utf-8")
    found = re.finditer(r"^```(\w*)\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    return [(text[: match.start()].count("\n") + 1, match[1], match[2]) for match in found]


def commands(page: Path) -> list[tuple[int, list[str]]]:
    """Line and arguments of every command ``yarnscale …`` of a page's blocks; a backslash continues a line."""
    found = []
    for line, _, content in blocks(page):
        for number, text in enumerate(content.replace("\\\n", " ").splitlines(), start=line + 1):
            if text.startswith("yarnscale "):
                found.append((number, shlex.split(text, comments=True)[1:]))
    return found


def small(arguments: list[str]) -> list[str] | None:
    """The arguments with smaller numbers; None for what is only parsed."""
    text = " ".join(arguments)
    for key, other in INSTEAD.items():
        if text.startswith(key):
            arguments = [*other.split(), *arguments[len(key.split()) :]]
            text = " ".join(arguments)
    if text.startswith(tuple(PARSED_ONLY)):
        return None
    known = sorted((key for key in SMALLER if text.startswith(key)), key=len)
    return [*arguments, *(SMALLER[known[-1]] if known else [])]


def run(page: Path, folder: Path, kept: Path) -> list[str]:
    """Run a page in a folder; returns what failed. kept: folder of what earlier pages homogenized."""
    environment = os.environ | {
        "PYTHONPATH": str(ROOT / "src"),
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    before = ["yarnscale samples --out .", *BEFORE.get(page.stem, [])]
    wanted = [(0, small(shlex.split(text)[1:])) for text in before]
    wanted += [(line, small(arguments)) for line, arguments in commands(page)]
    tasks = [(line, f"yarnscale {shlex.join(a)}", [sys.executable, "-m", "yarnscale", *a]) for line, a in wanted if a]
    tasks += [
        (line, f"Python: {content.splitlines()[0]} …", [sys.executable, "-c", content])
        for line, language, content in blocks(page)
        if language == "python"
    ]
    failed = []
    for line, name, command in tasks:
        out = folder / command[command.index("--out") + 1] if "homogenize" in command else None
        copy = kept / re.sub(r"\W+", "-", name)
        if out is not None and copy.is_dir():
            shutil.copytree(copy, out)
            continue
        began = time.perf_counter()
        ended = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
        print(f"{page.name}:{line}: {name}: status {ended.returncode}, {time.perf_counter() - began:.0f} s", flush=True)
        if ended.returncode:
            failed.append(f"{page.name}:{line}: {name}\n{ended.stderr[-2000:]}")
        elif out is not None:
            shutil.copytree(out, copy)
    return failed


def main() -> int:
    """Run the pages named, each in a folder of its own."""
    failed = []
    with tempfile.TemporaryDirectory() as kept:
        for name in sys.argv[1:]:
            with tempfile.TemporaryDirectory() as folder:
                page = Path(name)
                if commands(page) or any(language == "python" for _, language, _ in blocks(page)):
                    failed += run(page, Path(folder), Path(kept))
    print("\n".join(failed))
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())

"""Run what README.md and the pages of docs say: `python docs/run_commands.py README.md docs/guide/fabric.md`.

Every command of a block and every block of Python is run in a folder that holds the samples, in the order of the page,
costly ones with the smaller numbers of ``SMALLER``. ``PARSED_ONLY`` are only parsed: they take minutes whatever is made
smaller, and the tests of these commands run them on their own inputs.
"""

from __future__ import annotations

import os
import re
import shlex
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
    "simulate hang": ["--spacing", "0.05", "--animation", "--overwrite"],
    "fabric": ["--rows", "3", "--columns", "3", "--duration", "0.005", "--overwrite"],
    "fabric stockinette --method direct --on": ["--duration", "0.002"],
    "convert": ["--frames", "0", "--overwrite"],
    "detail": ["--frames", "0"],
    "view": ["--as-drawn"],
}
"""Beginning of a command -> options that make it small; the longest beginning counts."""
PARSED_ONLY = (
    "register",
    "estimate",
    "library",
    "test stockinette",
    "test knit/material.json --drape",
    "sample ",
)
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
    """Line and arguments of every command ``yarnscale …`` of a page's blocks."""
    found = []
    for line, _, content in blocks(page):
        for number, text in enumerate(content.splitlines(), start=line + 1):
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
    if text.startswith(PARSED_ONLY):
        return None
    known = sorted((key for key in SMALLER if text.startswith(key)), key=len)
    return [*arguments, *(SMALLER[known[-1]] if known else [])]


def run(page: Path, folder: Path) -> list[str]:
    """Run a page in a folder; returns what failed."""
    environment = os.environ | {
        "PYTHONPATH": str(ROOT / "src"),
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    program = [sys.executable, "-m", "yarnscale"]
    tasks = [(0, [*program, "samples", "--out", "."], "samples")]
    for text in BEFORE.get(page.stem, []):
        wanted = small(shlex.split(text)[1:])
        tasks.append((0, [*program, *(wanted or [])], text))
    for line, arguments in commands(page):
        if (wanted := small(arguments)) is not None:
            tasks.append((line, [*program, *wanted], " ".join(["yarnscale", *wanted])))
    for line, language, content in blocks(page):
        if language == "python":
            tasks.append((line, [sys.executable, "-c", content], f"Python: {content.splitlines()[0]} …"))
    failed = []
    for line, command, name in tasks:
        began = time.perf_counter()
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
        print(
            f"{page.name}:{line}: {name}: status {done.returncode}, {time.perf_counter() - began:.0f} s",
            flush=True,
        )
        if done.returncode:
            failed.append(f"{page.name}:{line}: {name}\n{done.stderr[-2000:]}")
    return failed


def main() -> int:
    """Run the pages named, each in a folder of its own."""
    failed = []
    for name in sys.argv[1:]:
        with tempfile.TemporaryDirectory() as folder:
            failed += run(Path(name), Path(folder))
    print("\n".join(failed))
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())

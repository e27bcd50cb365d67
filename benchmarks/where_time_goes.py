"""Where the processor time of each solver goes, and how far that is from its limit: factors and compiled kernels.

python benchmarks/where_time_goes.py [cell cloth direct volume estimate]

Every job is run twice, first to compile. Samples are weighted by the processor time since the one before, so that long
calls of compiled code count in full. Threads count for the function that waits for them.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import numpy as np

import yarnscale
from yarnscale.cell import PeriodicCell
from yarnscale.cli import main
from yarnscale.files import material_library
from yarnscale.files.patterns import read_pattern, read_yarns
from yarnscale.kinematics import ShellStrain

INTERVAL = 0.002
"""Of samples [s]."""
HOME = str(Path(yarnscale.__file__).parent)
PICTURES = "files, pictures"
WAITING = "numerics/threads"
"""Of threads, for which their caller waits."""
KINDS = {
    "numerics/multifrontal.": "factors, solves",
    "numerics/factor.": "factors, solves",
    "numerics/fronts.": "ordering",
    "numerics/kernel.": "kernels",
    "numerics/address_call.": "kernels",
    "numerics/assembly._run": "kernels",
    "numerics/assembly.": "assembly",
    "numerics/block_pattern.": "assembly",
    "shell/elastic/energy.": "kernels",
    "cell/poisson.": "mid-surface",
    "files/": PICTURES,
    "show/": PICTURES,
}
"""By how the innermost function of ours begins; of others, by the words below."""
CONTACT = ("contact", "touch", "pair", "friction", "search", "tree")
LIMIT = ("factors, solves", "kernels")
ORDER = (*LIMIT, "ordering", "assembly", "mid-surface", "contact", "other")
STATES, AMOUNT = 40, 0.04
"""States of the cell, and how large their strains are."""


class Sampled:
    """Processor time [s] of everything in its ``with``, by kind and by function."""

    def __init__(self) -> None:
        self.kinds: Counter[str] = Counter()
        self.functions: Counter[str] = Counter()
        self._last = 0.0

    def __enter__(self) -> Sampled:
        self._last = time.process_time()
        signal.signal(signal.SIGPROF, self._sample)
        signal.setitimer(signal.ITIMER_PROF, INTERVAL, INTERVAL)
        return self

    def __exit__(self, *_: object) -> None:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, signal.SIG_DFL)

    def _sample(self, _: int, frame: FrameType | None) -> None:
        now = time.process_time()
        spent, self._last = now - self._last, now
        while (frame is not None and not frame.f_code.co_filename.startswith(HOME)) or waits(frame):
            frame = frame.f_back
        if frame is None:
            self.kinds["other"] += spent
            return
        module = frame.f_code.co_filename[len(HOME) + 1 :].removesuffix(".py")
        function = f"{module}.{frame.f_code.co_name}"
        self.kinds[kind_of(function)] += spent
        self.functions[function] += spent


def waits(frame: FrameType | None) -> bool:
    return frame is not None and WAITING in frame.f_code.co_filename


def kind_of(function: str) -> str:
    """Of time in a function, by its path in the package."""
    for begin, kind in KINDS.items():
        if function.startswith(begin):
            return kind
    return "contact" if any(word in function for word in CONTACT) else "other"


def cell(_: Path) -> None:
    """Random strains of stockinette, each from rest."""
    file = material_library.file_of("stockinette-wool", material_library.PATTERN)
    yarns = read_yarns(file)
    assert yarns is not None
    relaxed, rng = PeriodicCell(read_pattern(file), yarns), np.random.default_rng(0)
    for _ in range(STATES):
        relaxed.relax(ShellStrain.from_vector(rng.normal(size=6) * AMOUNT * [1, 1, 1, 500, 500, 500]))


def cloth(out: Path) -> None:
    """The published stretch test."""
    command("simulate", "stretch-course", "--shell", "stockinette-wool", "--spacing", "0.01", "--out", str(out))


def direct(out: Path) -> None:
    """Every yarn of a stretched piece of stockinette with friction."""
    size = ("--rows", "14", "--columns", "8", "--as-drawn")
    scene = ("--scene", "stretch", "--duration", "0.1", "--friction", "0.3")
    command("fabric", "stockinette", "--method", "direct", *size, *scene, "--out", str(out))


def volume(out: Path) -> None:
    """Jersey that hangs in a homogenized volume."""
    size = ("--rows", "7", "--columns", "7", "--scene", "hang", "--duration", "0.3", "--damping", "20")
    command("fabric", "jersey", "--method", "volume", *size, "--out", str(out))


def estimate(out: Path) -> None:
    """One step of a search for the yarn of a fabric with two measured curves."""
    table = out.with_suffix(".csv")
    rows = [
        f"{direction},1,{force},{100 + slope * force},60"
        for direction, slope in (("weft", 2.0), ("warp", 1.0))
        for force in (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
    ]
    table.write_text("\n".join(["direction,run,force_N,clamp_distance_mm,swatch_width_mm", *rows]) + "\n")
    search = ("--solver", "local", "--iterations", "1", "--shape", "drawn", "--workers", "1")
    command("estimate", str(table), "--pattern", "stockinette", *search, "--out", str(out))


def command(*arguments: str) -> None:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        assert main(list(arguments)) == 0, arguments


JOBS: dict[str, Callable[[Path], None]] = {f.__name__: f for f in (cell, cloth, direct, volume, estimate)}


def shares(job: Callable[[Path], None]) -> Sampled:
    with tempfile.TemporaryDirectory() as folder:
        job(Path(folder) / "first")
        with Sampled() as sampled:
            job(Path(folder) / "second")
    return sampled


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("jobs", nargs="*", metavar="JOB", help=" ".join(JOBS))
    parser.add_argument("--functions", type=int, default=6, help="of each job, how many are listed")
    options = parser.parse_args()
    heads = [f"{PICTURES} [s]", "the rest [s]", *(f"{kind} [%]" for kind in ORDER), "over factors and kernels"]
    print("| " + " | ".join(["job", *heads]) + " |")
    print("|" + "---|" * (1 + len(heads)))
    found = {name: shares(JOBS[name]) for name in options.jobs or JOBS}
    for name, sampled in found.items():
        total = sum(sampled.kinds[kind] for kind in ORDER)
        parts = " | ".join(f"{100 * sampled.kinds[kind] / total:.0f}" for kind in ORDER)
        least = sum(sampled.kinds[kind] for kind in LIMIT)
        print(f"| {name} | {sampled.kinds[PICTURES]:.1f} | {total:.1f} | {parts} | {total / least:.1f} |")
    for name, sampled in found.items():
        total = sum(sampled.kinds[kind] for kind in ORDER)
        parts = (f"{f} {100 * s / total:.0f} %" for f, s in sampled.functions.most_common(options.functions))
        print(f"\n{name}: {', '.join(parts)}")

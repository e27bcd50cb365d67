"""Broken drafts, machine files, and arguments of gallery and library: one line with its place, status 2, no output."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest

HEAD = "[WIF]\nVersion=1.1\n[WEAVING]\nShafts=4\nTreadles=4\n"
THREADING, TIEUP = "[THREADING]\n1=1\n2=2\n3=3\n4=4\n", "[TIEUP]\n1=1,2\n2=2,3\n3=3,4\n4=1,4\n"
TREADLING = "[TREADLING]\n1=1\n2=2\n3=3\n4=4\n"
TWILL = HEAD + THREADING + TIEUP + TREADLING
KNIT = ";!knitout-2\n;;Carriers: 1 2\ninhook 1\n"
CAST_ON = KNIT + "".join(f"tuck - f{n} 1\n" for n in range(8, 0, -1))
ROW = "".join(f"knit + f{n} 1\n" for n in range(1, 9)) + "".join(f"knit - f{n} 1\n" for n in range(8, 0, -1))

WIF: dict[str, tuple[str, str]] = {
    "section of the format alone": ("[WIF]\nVersion=1.1\n", "[THREADING] is missing"),
    "section is not closed": (HEAD + "[THREADING\n1=1\n" + TIEUP + TREADLING, "[WEAVING]"),
    "no draft": ("Threads=4\n", "a section [WIF]"),
    "doubled brackets": (TWILL.replace("[WIF]", "[[WIF]]"), "a section [WIF]"),
    "negative number": (TWILL.replace("2=2,3", "2=-2,3"), ":13: [TIEUP] 2"),
    "fraction": (TWILL.replace("[THREADING]\n1=1", "[THREADING]\n1=1.5"), ":7: [THREADING] 1"),
    "digits of other scripts": (TWILL.replace("[THREADING]\n1=1", "[THREADING]\n１=1"), ":7: [THREADING]"),
    "words": (TWILL.replace("4=1,4", "4=all"), ":15: [TIEUP] 4"),
    "ten million digits": (TWILL + "5=" + "1" * 10_000_000 + "\n", ":21: [TREADLING] 5"),
    "key beyond the largest web": (TWILL + "4097=1\n", ":21: [TREADLING] 4097"),
    "many picks": (TWILL + "".join(f"{n}=1\n" for n in range(5, 300_000)), ":4113: [TREADLING] is too long"),
    "count beyond the largest web": (TWILL + "[WEFT]\nThreads=5000\n", ":22: [WEFT] threads"),
    "negative count": (TWILL + "[WARP]\nThreads=-4\n", ":22: [WARP] threads"),
    "fewer threads than keys": (TWILL + "[WEFT]\nThreads=2\n", ":19: [TREADLING] 3"),
    "more threads than keys": (TWILL + "[WARP]\nThreads=8\n", "[THREADING] 5"),
    "no treadle of this number": (TWILL + "5=9\n", ":21: [TREADLING] 5"),
    "pick of no shaft": (TWILL + "[LIFTPLAN]\n1=9\n2=1\n3=2,3\n4=4\n", ":22: draft does not hold together"),
    "liftplan of empty values": (TWILL + "[LIFTPLAN]\n1=\n2=\n3=\n4=\n", "expected a shaft"),
    "every pick lifts all": (TWILL.replace(TIEUP, "[TIEUP]\n1=1,2,3,4\n2=1,2,3,4\n3=1,2,3,4\n4=1,2,3,4\n"), "draft"),
    "no tie-up": (HEAD + THREADING + TREADLING, "[TIEUP] is missing or empty"),
    "tie-up empty": (HEAD + THREADING + "[TIEUP]\n" + TREADLING, "[TIEUP] is missing or empty"),
    "spacing without unit": (TWILL + "[WARP]\nSpacing=2\n", "[WARP] units"),
    "no room": (TWILL + "[WARP]\nUnits=cm\nSpacing=0\n", ":23: [WARP] spacing"),
    "infinite": (TWILL + "[WEFT]\nUnits=cm\nThickness=inf\n", ":23: [WEFT] thickness"),
    "smaller than atoms": (TWILL + "[WARP]\nUnits=cm\nSpacing=1e-300\n", "radius is out of range"),
    "colour is no number": (TWILL + "[WARP]\nColor=red\n", ":22: [WARP] color"),
    "shed": (TWILL.replace("Treadles=4", "Treadles=4\nRising Shed=perhaps"), ":6: [WEAVING] rising shed"),
    "control characters": (TWILL.replace("Version", "Ver\x00sion"), "file is not text"),
    "half of UTF-16": ("UTF-16", "file is not text"),
}  # fmt: skip
KNITOUT: dict[str, tuple[str, str]] = {
    "head alone": (KNIT, "file knits no fabric"),
    "comments alone": (";!knitout-2\n" + "; nothing\n" * 1000, "file knits no fabric"),
    "cast-on alone": (CAST_ON, "file knits no fabric"),
    "no needle": (CAST_ON + "knit + 1\n", ":12: bad instruction"),
    "needle with a fraction": (CAST_ON + "knit + f1.5 1\n", ":12: bad instruction"),
    "needle beyond the bed": (CAST_ON + "knit + f2000 1\n", ":12: bad instruction"),
    "needle of a million digits": (CAST_ON + f"knit + f{'9' * 1_000_000} 1\n", ":12: bad instruction"),
    "direction": (CAST_ON + "knit * f1 1\n", ":12: bad instruction"),
    "racked by nothing": (CAST_ON + "rack nan\n", ":12: bad instruction"),
    "racked by a billion": (CAST_ON + "rack 1000000000\n" + "knit + b1 1\n" * 20, ":12: bad instruction"),
    "unknown carrier": (CAST_ON + "knit + f1 7\n", ":12: unknown carrier"),
    "unknown instruction": (CAST_ON + "purl + f1 1\n", ":12: unknown instruction"),
    "transfer along the bed": (CAST_ON + ROW + "xfer f2 f3\n" + ROW, ":28: 'xfer f2 f3' moves a loop"),
    "split": (CAST_ON + ROW + "split + f2 b2 1\n" + ROW, ":28: 'split + f2 b2 1' splits"),
    "dropped": (CAST_ON + ROW + "drop f4\n" + ROW, ":28: 'drop f4' drops a loop"),
    "short row": (CAST_ON + ROW + "knit + f1 1\nknit - f1 1\n" * 3 + ROW, "short row or intarsia"),
    "twenty-five thousand courses": (CAST_ON + "knit + f1 1\nknit - f1 1\n" * 12_500, "file is too long"),
    "other program": ("G21\nG90\nG1 X0 Y0\n", "unknown instruction"),
}  # fmt: skip
CASES = [(".wif", *case) for case in WIF.items()] + [(".k", *case) for case in KNITOUT.items()]


@pytest.mark.parametrize(("suffix", "name", "case"), CASES, ids=[f"{s[1:]}-{n}" for s, n, _ in CASES])
def test_broken_files(
    refused: Callable[..., str], tmp_path: Path, suffix: str, name: str, case: tuple[str, str]
) -> None:
    text, message = case
    path = tmp_path / f"my{suffix}"
    path.write_bytes(TWILL.encode("utf-16")[:-1] if text == "UTF-16" else text.encode())
    refused("pattern", "lace", "--out", tmp_path / "out.json")  # imports all modules
    tracemalloc.start()
    line = refused("pattern", path, "--out", tmp_path / "out.json")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert str(path) in line and message in line and len(line) < 600
    assert peak < 20e6 + 40 * path.stat().st_size
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["gallery", "lace", "--out", "out"], "unknown pattern"),
        (["gallery", "missing.wif", "--out", "out"], "missing.wif"),
        (["gallery", "plain", "--out", "file"], "file"),
        (["gallery", "plain", "--workers", "0", "--out", "out"], "--workers"),
        (["library", "lace", "--out", "out"], "unknown pattern"),
        (["library", "plain", "--material", "silk", "--out", "out"], "unknown material"),
        (["library", "plain", "--material", "missing.toml", "--out", "out"], "missing.toml"),
        (["library", "plain", "--material", "file", "--out", "out"], "file"),
        (["library", "plain", "--out", "file"], "file"),
        (["library", "plain", "--solves", "0", "--out", "out"], "--solves"),
        (["library", "my.pyp", "--out", "out"], "my.pyp"),
        (["simulate", "hang", "--shell", "silk", "--out", "out"], "unknown shell material"),
        (["evaluate", "silk-wool", "--strain", "0,0,0,0,0,0"], "unknown shell material"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_bad_arguments(
    refused: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("x")
    assert message in refused(*arguments)
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]

"""WIF drafts: one repeat of the drawdown, sizes with their units, and every fault with its place."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.errors import InputError, InputNotice
from yarnscale.files.patterns import read_pattern, structure_of
from yarnscale.files.structure_file import repeat_of
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.material import PRESETS
from yarnscale.yarn.pattern import YarnPattern

HEAD = "[WIF]\nVersion=1.1\n[WEAVING]\nShafts=4\nTreadles=4\nRising Shed=true\n"
TIED = "[TIEUP]\n1=1,2\n2=2,3\n3=3,4\n4=1,4\n"
SHARED = Path(os.environ.get("YARNSCALE_SHARED", "shared")) / "files" / "wif"


def numbered(name: str, values: list) -> str:
    return "\n".join([f"[{name}]", *(f"{number}={value}" for number, value in enumerate(values, 1)), ""])


def twill(ends: int = 4, picks: int = 4, more: str = "", head: str = HEAD) -> str:
    threading = numbered("THREADING", [1 + end % 4 for end in range(ends)])
    treadling = numbered("TREADLING", [1 + pick % 4 for pick in range(picks)])
    return head + threading + TIED + treadling + more


def write(folder: Path, text: str | bytes, name: str = "my.wif") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def draft_of(path: Path) -> np.ndarray:
    structure = structure_of(path)
    assert structure is not None and structure.draft is not None
    return structure.draft


def drawdown(pattern: YarnPattern, picks: int, ends: int, positions: np.ndarray | None = None) -> np.ndarray:
    """Crossings of the yarns themselves: whether each end is above each pick where they cross in plan."""
    table = np.full((picks, ends), -1)
    positions = pattern.vertices if positions is None else positions
    chains = [positions[chain] for chain in pattern.yarns]
    for i, weft in enumerate(chains[:picks]):
        for j, warp in enumerate(chains[picks:]):
            apart = (weft[:, None, :2] - warp[None, :, :2]) / pattern.period
            far = np.linalg.norm((apart - np.round(apart)) * pattern.period, axis=2)
            a, b = np.unravel_index(far.argmin(), far.shape)
            table[i, j] = warp[b, 2] > weft[a, 2]
    return table


def test_one_repeat_of_the_web_is_drawn_and_relaxed_with_its_drawdown(tmp_path: Path) -> None:
    path = write(tmp_path, twill(40, 30))
    expected = np.array([[1, 1, 0, 0], [0, 1, 1, 0], [0, 0, 1, 1], [1, 0, 0, 1]])
    assert np.array_equal(draft_of(path), expected)
    pattern = read_pattern(path)
    assert np.array_equal(drawdown(pattern, 4, 4), expected)
    state = PeriodicCell(pattern, PRESETS["hylc2020-basket"]).relax(ShellStrain())
    assert np.array_equal(drawdown(pattern, 4, 4, state.positions), expected)


def test_a_liftplan_of_32_shafts_and_several_treadles_lift_the_same(tmp_path: Path) -> None:
    rows = np.random.default_rng(5).integers(0, 2, (12, 32))
    rows[:, 0], rows[0], rows[1] = rows[:, 5], np.arange(32) % 2, 1 - np.arange(32) % 2
    lifts = [",".join(str(1 + shaft) for shaft in np.flatnonzero(row)) for row in rows]
    head = HEAD.replace("Shafts=4", "Shafts=32").replace("Treadles=4", "Treadles=32")
    threading = numbered("THREADING", list(range(1, 33)))
    plan = write(tmp_path, head + threading + numbered("LIFTPLAN", lifts), "plan.wif")
    direct = head + threading + numbered("TIEUP", list(range(1, 33))) + numbered("TREADLING", lifts)
    treadled = write(tmp_path, direct, "treadled.wif")
    assert np.array_equal(draft_of(plan), rows) and np.array_equal(draft_of(treadled), rows)


def test_a_sinking_shed_lowers_its_shafts_and_zeros_lift_nothing(tmp_path: Path) -> None:
    rising = twill().replace("1=1,2\n", "1=0,1,2\n").replace("[TREADLING]\n1=1\n", "[TREADLING]\n1=0,1,\n")
    sinking = twill(head=HEAD.replace("Shed=true", "Shed=no"))
    table = draft_of(write(tmp_path, rising))
    assert np.array_equal(draft_of(write(tmp_path, sinking)), 1 - table)


@pytest.mark.parametrize(("unit", "metres"), [("Decipoints", 0.0254 / 720), ("inches", 0.0254), ("centimeters", 0.01)])
def test_spacing_and_thickness_have_units(tmp_path: Path, unit: str, metres: float) -> None:
    spacing, thickness = 0.002 / metres, 0.001 / metres
    sizes = "".join(
        f"[{system}]\nThreads=4\nUnits={unit}\nSpacing={spacing}\nThickness={thickness}\n"
        for system in ("WARP", "WEFT")
    )
    pattern = read_pattern(write(tmp_path, twill(more=sizes)))
    assert pattern.radius == pytest.approx(5e-4) and pattern.yarn_radius is None
    assert pattern.period == pytest.approx([8e-3, 8e-3])


def test_threads_have_their_own_colour_spacing_and_thickness(tmp_path: Path) -> None:
    more = (
        "[WARP]\nThreads=4\nColor=2\nSpacing=0.2\nThickness=0.08\nUnits=cm\n[WARP COLORS]\n2=1,255,0,0\n"
        "[WARP SPACING]\n3=0.3\n[WARP THICKNESS]\n4=0.1\n"
        "[WEFT]\nColor=2\nSpacing=0.25\nThickness=0.08\nUnits=cm\n"
    )
    pattern = read_pattern(write(tmp_path, twill(more=more)))
    assert pattern.yarn_material is not None and pattern.yarn_radius is not None
    assert pattern.yarn_material.tolist() == [1, 1, 1, 1, 1, 0, 1, 2]
    assert pattern.yarn_radius == pytest.approx([4e-4] * 7 + [5e-4])
    assert pattern.period == pytest.approx([9e-3, 10e-3])
    x = [pattern.vertices[chain][:, 0].mean() for chain in pattern.yarns[4:]]
    assert np.diff(x) == pytest.approx([2e-3, 2.5e-3, 2.5e-3])


def test_threads_without_room_are_drawn_thinner_and_a_notice_says_so(tmp_path: Path) -> None:
    sizes = "".join(f"[{s}]\nSpacing=0.2\nThickness=0.2\nUnits=cm\n" for s in ("WARP", "WEFT"))
    with pytest.warns(InputNotice, match="no room for 2 mm at this spacing"):
        pattern = read_pattern(write(tmp_path, twill(more=sizes)))
    assert pattern.radius == pytest.approx(0.002 / 3.2)


@pytest.mark.filterwarnings("ignore:.*left off")
def test_hems_and_selvedges_of_large_webs_are_left_off(tmp_path: Path) -> None:
    threading = [1, 3] * 4 + [1 + end % 4 for end in range(100)] + [2, 4] * 4
    treadling = [1, 3] * 3 + [1 + pick % 4 for pick in range(90)]
    text = HEAD + numbered("THREADING", threading) + TIED + numbered("TREADLING", treadling)
    assert draft_of(write(tmp_path, text)).shape == (4, 4)


@pytest.mark.parametrize(
    ("items", "expected"),
    [("abcd", (0, 4)), ("ababa", (0, 2)), ("abba", (0, 4)), ("aab" * 3, (0, 3)), ("a", (0, 1))],
)
def test_the_shortest_period_that_holds_is_the_repeat(items: str, expected: tuple[int, int]) -> None:
    assert repeat_of(items, 64) == (slice(*expected), 0)
    assert repeat_of("xy" + "abc" * 5 + "z", 64, 3) == (slice(2, 5), 3)
    assert repeat_of("abcdefgh", 4) is None


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
def test_encodings_of_machines_are_read(tmp_path: Path, encoding: str) -> None:
    text = twill(8, 8, "[TEXT]\nTitle=Köper\n").replace("\n", "\r\n").replace("[THREADING]", "[Threading]")
    assert draft_of(write(tmp_path, text.encode(encoding))).shape == (4, 4)
    assert draft_of(write(tmp_path, text.encode(encoding), "nameless")).shape == (4, 4)


BROKEN = {
    "no section": ("THREADING", ": file is no weaving draft"),
    "no threading": (twill().replace("[THREADING]", "[OTHER]"), ": [THREADING] is missing or empty"),
    "no tie-up": (twill().replace("[TIEUP]", "[OTHER]"), ": [TIEUP] is missing or empty; expected [THREADING], and"),
    "no treadling": (twill().split("[TREADLING]")[0], ": [TREADLING] is missing or empty"),
    "contents": (twill(more="[CONTENTS]\nWARP=true\n"), ": [WARP] is missing; expected what [CONTENTS] names"),
    "threads": (twill(more="[WARP]\nThreads=1000000000\n"), ":23: [WARP] threads; expected whole numbers"),
    "no number": (twill().replace("3=3\n", "3=three\n", 1), ":10: [THREADING] 3; expected whole numbers"),
    "huge key": (twill(more="5000000000=1\n"), ":22: [TREADLING] 5000000000; expected a number from 1 to"),
    "thread 0": (twill().replace("[THREADING]\n", "[THREADING]\n0=1\n"), ":8: [THREADING] 0; expected"),
    "too many": (twill(more="[WARP]\nThreads=3\n"), ":11: [THREADING] 4; expected a number from 1 to 3"),
    "shaft": (twill().replace("4=4\n", "4=99\n", 1), ":11: [THREADING] 4; expected numbers from 0 to 4, or"),
    "treadle": (twill(more="5=7\n"), ":22: [TREADLING] 5; expected numbers from 0 to 4, or others"),
    "end on no shaft": (twill().replace("4=4\n", "4=0\n", 1), ":11: [THREADING] 4; expected a shaft or treadle, or"),
    "pick without shed": (twill(more="5=0\n"), ":22: [TREADLING] 5; expected a shaft or treadle, or"),
    "twice": (twill(more="4=1\n"), ":22: [TREADLING] '4=1' occurs twice; expected key=value, every"),
    "section twice": (twill(more="[TIEUP]\n1=1\n"), ":22: [TIEUP] occurs twice; expected every section once"),
    "no setting": (twill(more="garbage\n"), ":22: [TREADLING] 'garbage' is no setting"),
    "unit": (twill(more="[WARP]\nUnits=furlongs\nSpacing=1\n"), ":23: [WARP] units; expected one of decipoints"),
    "spacing": (twill(more="[WARP]\nUnits=cm\nSpacing=-1\n"), ":24: [WARP] spacing; expected a positive"),
    "nan": (twill(more="[WEFT]\nUnits=cm\nThickness=nan\n"), ":24: [WEFT] thickness; expected a positive"),
    "gap": (twill(more="[WARP]\nUnits=cm\n[WARP SPACING]\n1=1\n"), ":24: [WARP SPACING] 2; expected a size"),
    "huge": (twill(more="[WARP]\nUnits=cm\nSpacing=1e300\n"), ":24: radius is out of range"),
    "shed": (twill().replace("Shed=true", "Shed=up"), ":6: [WEAVING] rising shed; expected true or false"),
    "layers": (twill().replace(TIED, "[TIEUP]\n1=1,2,3\n2=1\n3=1,3,4\n4=3\n"), "draft does not hold together"),
    "binary": ("[WIF]\0\1\2", ": file is not text"),
    "empty": ("", ": file is empty"),
}  # fmt: skip


@pytest.mark.parametrize("case", BROKEN)
def test_faults_are_answered_in_one_line_with_their_place(tmp_path: Path, case: str) -> None:
    text, message = BROKEN[case]
    path = write(tmp_path, text)
    with pytest.raises(InputError) as caught:
        read_pattern(path)
    told = str(caught.value)
    assert told.startswith(str(path)) and message in told and "\n" not in told


def test_a_web_without_repeat_is_refused(tmp_path: Path) -> None:
    threading = np.random.default_rng(3).integers(1, 5, 100).tolist()
    text = HEAD + numbered("THREADING", threading) + TIED + numbered("TREADLING", [1, 2, 3, 4])
    with pytest.raises(InputError, match="the 100 ends have no repeat; expected one of at most 64"):
        read_pattern(write(tmp_path, text))


@pytest.mark.parametrize(
    ("name", "rows"),
    [
        ("two color single treadles", "1010 0101 1011 0111 1110 1101"),
        ("eighteen shaft liftplan", "1011 0101 1011 0111 1110 1101"),
        ("many color multiple treadles and zeros", ""),
    ],
)
def test_files_of_other_programs(name: str, rows: str) -> None:
    path = SHARED / f"{name}.wif"
    if not path.exists():
        pytest.skip("the shared drafts are not here")
    if not rows:
        with pytest.raises(InputError, match=r"\[THREADING\] 4; expected a shaft"):
            read_pattern(path)
        return
    expected = np.array([[int(over) for over in row] for row in rows.split()])
    assert np.array_equal(draft_of(path), expected)
    pattern = read_pattern(path)
    assert np.array_equal(drawdown(pattern, *expected.shape), expected)
    kinds = 1 if pattern.yarn_material is None else int(pattern.yarn_material.max()) + 1
    state = PeriodicCell(pattern, [PRESETS["hylc2020-basket"]] * kinds).relax(ShellStrain())
    assert state.converged
    assert np.array_equal(drawdown(pattern, *expected.shape, positions=state.positions), expected)

"""The cache of object code: what does not match, or what others could write, is rebuilt and never run."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from yarnscale.numerics import object_cache

CODE = bytes(range(256)) * 4


class Builder:
    """Counts how often code had to be built."""

    def __init__(self, code: bytes = CODE) -> None:
        self.code, self.builds = code, 0

    def __call__(self) -> bytes:
        self.builds += 1
        return self.code


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "cache"
    monkeypatch.setenv("YARNSCALE_CACHE", str(folder))
    return folder


def stored(cache: Path) -> Path:
    (entry,) = cache.glob("*.o")
    return entry


def test_the_second_request_is_served_from_disk(cache: Path) -> None:
    build = Builder()
    assert object_cache.fetch("key", build) == CODE
    assert object_cache.fetch("key", build) == CODE
    assert build.builds == 1


def test_folder_and_entries_are_private(cache: Path) -> None:
    object_cache.fetch("key", Builder())
    assert cache.stat().st_mode & 0o077 == 0
    assert stored(cache).stat().st_mode & 0o077 == 0


def test_another_key_is_another_entry(cache: Path) -> None:
    first, second = Builder(), Builder(b"other code")
    object_cache.fetch("key", first)
    assert object_cache.fetch("another key", second) == b"other code"
    assert (first.builds, second.builds) == (1, 1)


def truncate(content: bytes) -> bytes:
    return content[:-7]


def flip_last(content: bytes) -> bytes:
    return content[:-1] + bytes([content[-1] ^ 1])


def flip_header(content: bytes) -> bytes:
    return content[:30] + bytes([content[30] ^ 0x80]) + content[31:]


def append(content: bytes) -> bytes:
    return content + b"\x90"


def empty(content: bytes) -> bytes:
    return b""


def header_only(content: bytes) -> bytes:
    return content[: len(object_cache._MAGIC) + 64]


@pytest.mark.parametrize("spoil", [truncate, flip_last, flip_header, append, empty, header_only])
def test_a_spoilt_entry_is_rebuilt(cache: Path, spoil: Callable[[bytes], bytes]) -> None:
    build = Builder()
    object_cache.fetch("key", build)
    entry = stored(cache)
    entry.write_bytes(spoil(entry.read_bytes()))
    assert object_cache.fetch("key", build) == CODE
    assert build.builds == 2
    assert object_cache.fetch("key", build) == CODE
    assert build.builds == 2, "the rebuilt entry must have replaced the spoilt one"


def test_every_single_flipped_bit_of_the_header_is_noticed(cache: Path) -> None:
    build = Builder()
    object_cache.fetch("key", build)
    entry = stored(cache)
    good = entry.read_bytes()
    for byte in range(len(object_cache._MAGIC) + 64):
        entry.write_bytes(good[:byte] + bytes([good[byte] ^ 4]) + good[byte + 1 :])
        object_cache.fetch("key", build)
    assert build.builds == 1 + len(object_cache._MAGIC) + 64


def test_an_entry_copied_from_another_key_is_rebuilt(cache: Path) -> None:
    object_cache.fetch("other", Builder(b"evil"))
    content = stored(cache).read_bytes()
    build = Builder()
    object_cache.fetch("key", build)
    (entry,) = [path for path in cache.glob("*.o") if path.read_bytes() != content]
    entry.write_bytes(content)
    assert object_cache.fetch("key", build) == CODE
    assert build.builds == 2


@pytest.mark.skipif(os.name != "posix", reason="POSIX permissions")
@pytest.mark.parametrize("mode", [0o602, 0o620, 0o666])
def test_an_entry_that_others_may_write_is_rebuilt(cache: Path, mode: int) -> None:
    build = Builder()
    object_cache.fetch("key", build)
    stored(cache).chmod(mode)
    assert object_cache.fetch("key", build) == CODE
    assert build.builds == 2
    assert stored(cache).stat().st_mode & 0o077 == 0


@pytest.mark.skipif(os.name != "posix", reason="POSIX permissions")
@pytest.mark.parametrize("mode", [0o777, 0o770, 0o702])
def test_a_folder_that_others_may_write_is_not_used(cache: Path, mode: int) -> None:
    build = Builder()
    object_cache.fetch("key", build)
    cache.chmod(mode)
    assert object_cache.fetch("key", build) == CODE
    assert build.builds == 2
    before = sorted(path.name for path in cache.iterdir())
    object_cache.fetch("new key", build)
    assert sorted(path.name for path in cache.iterdir()) == before, "nothing may be stored there either"


@pytest.mark.skipif(os.name != "posix", reason="symbolic links")
def test_links_are_not_followed(cache: Path, tmp_path: Path) -> None:
    build = Builder()
    object_cache.fetch("key", build)
    entry = stored(cache)
    elsewhere = tmp_path / "elsewhere.o"
    elsewhere.write_bytes(entry.read_bytes())
    entry.unlink()
    entry.symlink_to(elsewhere)
    object_cache.fetch("key", build)
    assert build.builds == 2
    assert not entry.is_symlink()


@pytest.mark.skipif(os.name != "posix", reason="POSIX permissions")
def test_an_entry_of_another_owner_is_rebuilt(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    build = Builder()
    object_cache.fetch("key", build)
    monkeypatch.setattr(os, "getuid", lambda: 123456)
    object_cache.fetch("key", build)
    assert build.builds == 2


def test_no_folder_at_all_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("not a folder")
    monkeypatch.setenv("YARNSCALE_CACHE", str(tmp_path / "file" / "cache"))
    assert object_cache.fetch("key", Builder()) == CODE


def test_a_failing_build_leaves_nothing_behind(cache: Path) -> None:
    def fail() -> bytes:
        raise RuntimeError("no compiler today")

    with pytest.raises(RuntimeError):
        object_cache.fetch("key", fail)
    assert list(cache.iterdir()) == []


def test_a_compiled_kernel_survives_a_spoilt_entry(cache: Path) -> None:
    """The whole way: a spoilt file on disk, and the kernel still computes the right thing."""
    import casadi as ca
    import numpy as np

    from yarnscale.numerics.kernel import compile_kernel, run_columns

    x = ca.SX.sym("x")
    function = ca.Function("f", [x], [3 * x + 0.125])
    compile_kernel(function, "first")
    entry = stored(cache)
    entry.write_bytes(entry.read_bytes()[:-100] + b"\x00" * 100)
    (found,) = run_columns(compile_kernel(function, "second"), np.array([[2.0]]))
    assert found[0, 0] == 6.125


_WORKER = """
import casadi as ca, numpy as np
from yarnscale.numerics.kernel import compile_kernel, run_columns
x = ca.SX.sym("x", 3)
energy = ca.sin(ca.dot(x, x)) * ca.exp(x[0])
function = ca.Function("f", [x], [energy, ca.gradient(energy, x)], {"cse": True})
for _ in range(3):
    value, _ = run_columns(compile_kernel(function, "shared"), np.array([[0.0, 0.5, 0.5]]))
print(float(value[0, 0]))
"""


def test_processes_that_compile_at_once_do_not_disturb_each_other(cache: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", _WORKER]
    workers = [subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) for _ in range(4)]
    answers = [worker.communicate(timeout=120)[0].strip() for worker in workers]
    assert [worker.returncode for worker in workers] == [0] * 4
    assert {round(float(answer), 12) for answer in answers} == {0.479425538604}
    assert len(list(cache.iterdir())) == 1, "one entry, no temporary files"

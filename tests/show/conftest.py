"""A real browser for tests of pages."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Browser]:
    """Headless Chromium; the test is skipped where there is none."""
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine")
    made = Browser(tmp_path / "profile")
    yield made
    made.close()


class Browser:
    """Chromium driven through the pipe of its DevTools. faults: exceptions and errors of its pages."""

    def __init__(self, profile: Path) -> None:
        ours_in, theirs_out = os.pipe()
        theirs_in, ours_out = os.pipe()

        def ends() -> None:
            # Chromium reads commands from 3 and writes answers to 4.
            a, b = os.dup(theirs_in), os.dup(theirs_out)
            os.dup2(a, 3)
            os.dup2(b, 4)

        # WebGL by the processor.
        flags = [
            "--headless", "--no-sandbox", "--disable-dev-shm-usage", "--remote-debugging-pipe",
            "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
        ]  # fmt: skip
        assert CHROMIUM is not None
        self.process = subprocess.Popen(
            [CHROMIUM, *flags, "--window-size=1400,1000", f"--user-data-dir={profile}", "about:blank"],
            preexec_fn=ends, close_fds=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(theirs_in)
        os.close(theirs_out)
        self._read, self._write = (
            os.fdopen(ours_in, "rb", buffering=0),
            os.fdopen(ours_out, "wb", buffering=0),
        )
        self._buffer, self._number, self._session = b"", 0, None
        self.faults: list[Any] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        self.call("Runtime.enable")
        self.call("Log.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        self._write.write(json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self._buffer:
                more = self._read.read(65536)
                assert more, "the browser has gone"
                self._buffer += more
            text, self._buffer = self._buffer.split(b"\0", 1)
            answer = json.loads(text)
            if answer.get("method") in ("Runtime.exceptionThrown", "Log.entryAdded"):
                self.faults.append(answer["params"])
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]

    def value(self, script: str) -> Any:
        found = self.call("Runtime.evaluate", expression=script, returnByValue=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def until(self, script: str, seconds: float = 90.0) -> None:
        ends = time.monotonic() + seconds
        while not self.value(script):
            assert time.monotonic() < ends, (script, self.faults, self.value("document.body.innerText")[:500])
            time.sleep(0.1)

    def mouse(self, kind: str, at: tuple[float, float]) -> None:
        held = {"button": "left", "buttons": 1, "clickCount": 1}
        self.call("Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], **held)

    def drag(self, selector: str, by: tuple[float, float]) -> None:
        box = self.value(
            f"(() => {{const b = document.querySelector('{selector}').getBoundingClientRect();"
            "return [b.x + b.width / 2, b.y + b.height / 2]})()"
        )
        self.mouse("mousePressed", tuple(box))
        for step in (0.3, 0.7, 1.0):
            self.mouse("mouseMoved", (box[0] + step * by[0], box[1] + step * by[1]))
        self.mouse("mouseReleased", (box[0] + by[0], box[1] + by[1]))

    def press(self, key: str, modifiers: int = 0) -> None:
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, modifiers=modifiers)

    def close(self) -> None:
        self.process.terminate()
        self.process.wait(20)

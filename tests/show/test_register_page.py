"""The page of a registration: who it answers, and drags in a real browser."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.files.pattern_json import read_pattern_json, write_pattern_json
from yarnscale.files.photograph import read_photograph
from yarnscale.files.registration_json import Session, read_session
from yarnscale.show.register_page import RegistrationPage
from yarnscale.swatches.registration.curves import YarnCurves
from yarnscale.swatches.registration.registration import Registration, registered
from yarnscale.swatches.registration.start import flattened

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.fixture
def page(lit_picture: Callable[..., np.ndarray], tmp_path: Path) -> Iterator[RegistrationPage]:
    """A page over a first guess of stockinette, in a thread; finishing writes out.json."""
    true = YarnCurves.of(library.build("stockinette", radius=1.0))
    photographs = {}
    for side in ("front", "back"):
        pixels = np.clip(lit_picture(true, side), 0, 255).astype(np.uint8)
        Image.fromarray(pixels).save(tmp_path / f"{side}.png")
        photographs[side] = read_photograph(tmp_path / f"{side}.png")
    pictures = flattened({side: photograph.brightness for side, photograph in photographs.items()})
    drawing, guess = registered(library.structure("stockinette"), pictures, pixel=0.5e-3 / 6, name="knit")
    session = Session(tmp_path / "out.register.json", "same", guess).saved()

    def finish(finished: Session) -> None:
        write_pattern_json(finished.current.pattern(drawing), tmp_path / "out.json")

    images = {side: photograph.png() for side, photograph in photographs.items()}
    made = RegistrationPage(session, images, pictures, finish)
    thread = threading.Thread(target=made.serve, daemon=True)
    thread.start()
    yield made
    made._server.shutdown()
    thread.join(10)


def _status(address: str, data: bytes | None = None, **headers: str) -> int:
    names = {name.replace("_", "-"): value for name, value in headers.items()}
    try:
        with urllib.request.urlopen(urllib.request.Request(address, data, names), timeout=20) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code


def test_it_answers_nobody_else(page: RegistrationPage) -> None:
    own, root = page.address, page.address.rsplit("/", 2)[0]
    assert own.startswith("http://127.0.0.1:") and _status(own) == 200
    assert _status(own + "front.png") == _status(own + "state") == 200
    assert _status(root + "/") == _status(root + "/guess/state") == _status(own + "../state") == 404
    assert _status(own + "etc/passwd") == _status(own + "side.png") == 404
    assert _status(own, Host="evil.example") == 403
    undo = {"Content_Type": "application/json"}
    assert _status(own + "undo", b"{}", **undo) == 200
    assert _status(own + "undo", b"{}", **undo, Origin="http://evil.example") == 403
    assert _status(own + "undo", b"{}", Content_Type="text/plain") == 415
    assert _status(own + "move", b"x" * 20_000, **undo) == 413
    assert _status(own + "move", b"{", **undo) == 400
    for request in ({}, {"side": "front", "point": 1.5}, {"side": "front", "point": 1, "place": [1, "x"]}):
        with pytest.raises(InputError):
            page.answer("move", request)
    with pytest.raises(InputError, match="free port"):
        RegistrationPage(page.session, {}, {}, print, port=int(root.rsplit(":", 1)[1]))


def test_changes_that_fail_are_told_and_leave_nothing(page: RegistrationPage, monkeypatch: pytest.MonkeyPatch) -> None:
    def told(name: str, data: bytes) -> str:
        made = urllib.request.Request(page.address + name, data, {"Content-Type": "application/json"})
        with urllib.request.urlopen(made, timeout=20) as answer:
            return json.loads(answer.read())["error"]

    before, written = page.session, page.session.path.read_bytes()
    assert "side" in told("move", b'{"side": [], "point": 1, "place": [1, 2]}')
    assert "this change failed" in told("move", b"[" * 9000) and "this change failed" in told("undo", b"[]")
    request = b'{"side": "front", "point": 1, "place": [9, 9]}'

    def singular(*arguments: object) -> None:
        raise np.linalg.LinAlgError("Singular matrix")

    for owner, name in ((Registration, "moved"), (Registration, "seen")):
        with monkeypatch.context() as patched:
            patched.setattr(owner, name, singular)
            assert "this change failed" in told("move", request)
    assert page.session is before and page.session.path.read_bytes() == written
    assert page.answer("move", json.loads(request))["undo"] == 1 and page.session.path.read_bytes() != written


class Browser:
    """Chromium driven through the pipe of its DevTools."""

    def __init__(self, profile: Path) -> None:
        ours_in, theirs_out = os.pipe()
        theirs_in, ours_out = os.pipe()

        def ends() -> None:
            # Chromium reads commands from 3 and writes answers to 4.
            a, b = os.dup(theirs_in), os.dup(theirs_out)
            os.dup2(a, 3)
            os.dup2(b, 4)

        flags = [
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-dev-shm-usage",
            "--remote-debugging-pipe",
        ]
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
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]

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
            assert time.monotonic() < ends, (
                script,
                self.value("document.getElementById('told').textContent"),
            )
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


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
def test_drags_change_the_state_and_the_pattern(page: RegistrationPage, tmp_path: Path) -> None:
    start = page.session.current
    browser = Browser(tmp_path / "profile")
    try:
        browser.call("Page.navigate", url=page.address)
        browser.until("document.querySelectorAll('#front .point').length > 5 && !busy")
        point = '#front .point[data-point="3"]'
        browser.drag(point, (14.0, -9.0))
        browser.until("state.undo === 1 && !busy")
        moved = page.session.current
        assert moved.pins == {3}
        away = (moved.curves.controls - start.curves.controls)[:, :2]
        assert np.abs(np.delete(away, 3, axis=0)).max() == 0.0
        # To the right and upwards on the screen is along x and y of the front.
        assert away[3, 0] > 0.0 and away[3, 1] > 0.0 and away[3, 0] / away[3, 1] == pytest.approx(14 / 9, rel=0.1)
        # What was done is in the file: a killed command goes on from it.
        kept = read_session(page.session.path, "same")
        assert kept is not None and kept.current.pins == {3} and len(kept.earlier) == 1
        browser.press("ArrowLeft")
        browser.until("state.undo === 2 && !busy")
        browser.press("z", modifiers=2)
        browser.until("state.undo === 1 && !busy")
        assert page.session.current.curves.controls == pytest.approx(moved.curves.controls)
        browser.drag('#back .corner[data-corner="origin"]', (10.0, 0.0))
        browser.until("state.undo === 2 && !busy")
        assert np.abs(page.session.current.lattices["back"].origin - start.lattices["back"].origin).max() > 0.5
        browser.press("z", modifiers=2)
        browser.until("state.undo === 1 && !busy")
        browser.value("document.getElementById('finish').click()")
        browser.until("document.getElementById('finish').disabled && document.getElementById('undo').disabled")
    finally:
        browser.close()
    pattern = read_pattern_json(tmp_path / "out.json")
    assert pattern.period == pytest.approx(start.curves.period)
    drawing = library.build("stockinette")
    assert pattern.vertices == pytest.approx(page.session.current.pattern(drawing).vertices)
    unmoved = start.pattern(drawing)
    assert abs(pattern.rest_length.sum() / unmoved.rest_length.sum() - 1.0) > 1e-3

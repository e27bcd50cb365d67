"""The page of a registration: who it answers, and drags in a real browser."""

from __future__ import annotations

import json
import threading
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


@pytest.mark.slow
def test_drags_change_the_state_and_the_pattern(page: RegistrationPage, browser: Any, tmp_path: Path) -> None:
    start = page.session.current
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
    pattern = read_pattern_json(tmp_path / "out.json")
    assert pattern.period == pytest.approx(start.curves.period)
    drawing = library.build("stockinette")
    assert pattern.vertices == pytest.approx(page.session.current.pattern(drawing).vertices)
    unmoved = start.pattern(drawing)
    assert abs(pattern.rest_length.sum() / unmoved.rest_length.sum() - 1.0) > 1e-3

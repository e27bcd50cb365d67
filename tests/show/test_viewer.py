"""Pages that turn, stretch and play: what a real browser draws of them, and what they answer."""

from __future__ import annotations

import json
import socket
import struct
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator
from threading import Thread
from typing import Any

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from yarnscale.cell import PeriodicCell
from yarnscale.cli.view import View, ViewPage
from yarnscale.detail.fluctuations import ScatteredFluctuations
from yarnscale.drawing import library
from yarnscale.files.animation import Animation, Moment, Surface
from yarnscale.kinematics import ShellStrain
from yarnscale.shell.mesh import rectangle
from yarnscale.show.local_page import NONCE
from yarnscale.show.run_pane import run_pane
from yarnscale.show.strained_pane import States, _coefficients, _modes, cell_pane, shown_states
from yarnscale.yarn.material import YarnMaterial

CELL = PeriodicCell(library.build("plain"), YarnMaterial.preset("wool"))
STRAINS = (
    ShellStrain(),
    ShellStrain(s_x=0.1),
    ShellStrain(s_x=0.05, s_a=0.2, s_y=-0.03, II11=40.0, II12=20.0, II22=10.0),
)


@pytest.fixture(scope="module")
def states() -> States:
    """Three equilibria, the last one doubly curved."""
    return shown_states({str(k): CELL.relax(strain) for k, strain in enumerate(STRAINS)})


@pytest.fixture(scope="module")
def page(states: States) -> Iterator[ViewPage]:
    """A cell, and a sheet that rolls up in five frames, served in a thread."""
    mesh = rectangle(0.1, 0.1, 0.01)

    def moment(k: int) -> Moment:
        x, y = mesh.material.T
        bend = 1e-3 + 5.0 * k
        return Moment(0.1 * k, np.column_stack([np.sin(bend * x) / bend, y, (1 - np.cos(bend * x)) / bend]))

    run = Animation(0.1 * np.arange(5), moment, Surface(mesh.triangles, mesh.material, mesh.triangles))
    view = View("test", (cell_pane(CELL, states, "cell"), run_pane(run, "sheet")), {})
    served = ViewPage(view.page(NONCE))
    thread = Thread(target=served.serve, daemon=True)
    thread.start()
    yield served
    served.close()
    thread.join(10)


def test_it_answers_with_its_page_only(page: ViewPage) -> None:
    own = page.address
    with urllib.request.urlopen(own, timeout=20) as answer:
        text = answer.read().decode()
        assert NONCE not in text and "nonce-" in answer.headers["Content-Security-Policy"]
    for address in (own + "state", own + "../", own + "etc/passwd", own.rsplit("/", 2)[0] + "/", own + "%2e%2e/x"):
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(address, timeout=20)
    post = urllib.request.Request(own + "undo", b"{}", {"Content-Type": "application/json"})
    with pytest.raises(urllib.error.HTTPError, match="404"):
        urllib.request.urlopen(post, timeout=20)


def test_a_browser_that_leaves_is_not_told_as_a_fault(capfd: pytest.CaptureFixture[str]) -> None:
    served = ViewPage(20_000_000 * "x")
    thread = Thread(target=served.serve, daemon=True)
    thread.start()
    place = urllib.parse.urlsplit(served.address)
    with socket.create_connection((place.hostname, place.port), timeout=20) as browser:
        browser.sendall(f"GET {place.path} HTTP/1.1\r\nHost: {place.netloc}\r\n\r\n".encode())
        assert b"200" in browser.recv(100)
        browser.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    with urllib.request.urlopen(served.address, timeout=20) as answer:
        assert answer.status == 200
    served.close()
    thread.join(10)
    assert capfd.readouterr().err == ""


def test_no_title_ends_its_script(states: States) -> None:
    title = "</script><!--<script>"
    text = cell_pane(CELL, states, title).text()
    assert "<" not in text and json.loads(text)["title"] == title


def test_the_page_interpolates_as_yarns_on_cloth_do() -> None:
    rng = np.random.default_rng(1)
    states, values = rng.normal(size=(30, 6)), rng.normal(size=(30, 4)) @ rng.normal(size=(4, 60))
    known = ScatteredFluctuations(states, values, np.ones(6))
    shares, modes = _modes(values, 1e-9)
    assert len(modes) == 4
    coefficients, places = _coefficients(states, shares), rng.normal(size=(5, 6))
    rows = np.column_stack([cdist(places, states), np.ones(5), places])
    assert rows @ coefficients @ modes == pytest.approx(known.at(places), abs=1e-9)


def test_no_load_begins_when_patience_is_out() -> None:
    found = States.loaded(CELL, patience=0.0)
    assert len(found.strains) == 1 and not found.paths and cell_pane(CELL, found, "rest").header["states"] == 1


@pytest.mark.slow
def test_a_browser_draws_turns_stretches_and_plays(page: ViewPage, states: States, browser: Any) -> None:
    browser.call("Page.navigate", url=page.address)
    browser.until("window.panes && panes.length === 2 && panes.every(pane => pane.drawn)")
    canvas, size = "panes[0].canvas", "panes[0].canvas.width, panes[0].canvas.height"
    pixels = f"Array.from({canvas}.getContext('2d').getImageData(0, 0, {size}).data)"
    inked = f"{pixels}.filter((value, k) => k % 4 === 2 && value < 250).length / {canvas}.width / {canvas}.height"
    assert browser.value(inked) > 0.05

    def changed(pane: int, done: Any) -> bool:
        picture = f"panes[{pane}].canvas.toDataURL()"
        before, drawn = browser.value(picture), browser.value(f"panes[{pane}].drawn")
        done()
        browser.until(f"panes[{pane}].drawn > {drawn}")
        return browser.value(picture) != before

    # What the page places is where Python places it, at every equilibrium.
    arrays = "panes[0].model.arrays"
    points = (
        np.array(browser.value(f"Array.from({arrays}.vertex)")),
        np.array(browser.value(f"Array.from({arrays}.tile)")),
    )
    own = (points[1].reshape(-1, 2) == 0).all(axis=1)
    for strain in STRAINS:
        placed = browser.value(f"panes[0].model.strain = {strain.vector.tolist()}, Array.from(panes[0].model.points())")
        expected = CELL.placement(CELL.relax(strain))(points[0], points[1].reshape(-1, 2))
        error = np.linalg.norm(np.array(placed).reshape(-1, 3) - expected, axis=1)
        # Copies on doubly curved surfaces lack a correction of the second order in curvature times distance.
        assert error[own].max() < 0.03 * CELL.pattern.radius and error.max() < 0.3 * CELL.pattern.radius
    browser.value("panes[0].go(0)")
    assert changed(0, lambda: browser.drag("canvas", (120.0, 40.0)))
    assert changed(0, lambda: browser.press("ArrowLeft"))
    slider = "document.querySelector('.sliders input')"
    assert changed(
        0, lambda: browser.value(f"{slider}.value = {slider}.max; {slider}.dispatchEvent(new Event('input'))")
    )
    assert "10 %" in browser.value("document.querySelector('.sliders output').textContent")
    # Colours of stretch count from rest, whatever is shown when they are chosen.
    script = "((model, field) => [model.values('yarns', field, model.points())[0], field.high])"
    share, high = browser.value(f"{script}(panes[0].model, panes[0].header.colours[2].fields.yarns)")
    ends = (CELL.placement(CELL.relax(strain))(points[0][:2], points[1].reshape(-1, 2)[:2]) for strain in STRAINS[:2])
    rest, pulled = (np.linalg.norm(end[1] - end[0]) for end in ends)
    assert (2.0 * share - 1.0) * high == pytest.approx(pulled / rest - 1.0, abs=1e-4)
    shown = browser.value("document.querySelector('.numbers').innerText")
    assert "J/m²" in shown and "N/m" in shown
    assert changed(1, lambda: browser.value("document.querySelectorAll('.bar button')[1].click()"))
    browser.until("panes[1].model.frame === 4 && !panes[1].playing")
    choice = "document.querySelectorAll('.pane select')[2]"
    assert changed(1, lambda: browser.value(f"{choice}.value = 1; {choice}.dispatchEvent(new Event('change'))"))
    assert not browser.faults

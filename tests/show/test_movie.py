"""Movies: which frame when, what the colours mean, and that both sides and all frames are seen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.files.animation import Animation, Moment, Surface
from yarnscale.files.curve_frames import CurveSet
from yarnscale.files.tube_sweep import TubeSweep
from yarnscale.shell.mesh import rectangle
from yarnscale.show import theme
from yarnscale.show.canvas import PicturesUnavailable, require_renderer
from yarnscale.show.movie import Film, largest_stretch, playing_order, vertex_stretch, write_movie
from yarnscale.show.seen_tubes import seen_tubes

MESH = rectangle(0.1, 0.1, 0.02)
SURFACE = Surface(MESH.triangles, MESH.material, MESH.corners)


@pytest.fixture(scope="module")
def drawing() -> None:
    try:
        require_renderer()
    except PicturesUnavailable as error:
        pytest.skip(str(error))


def test_the_nearest_frame_is_shown_in_real_time() -> None:
    times = np.array([1.0, 1.1, 1.2, 1.5])
    assert playing_order(times, fps=10) == [0, 1, 2, 2, 3, 3]
    assert playing_order(times, fps=20, speed=2) == playing_order(times, fps=10)
    assert playing_order(times, fps=2) == [0, 3]
    assert playing_order(times[:1], fps=30) == [0]
    order = playing_order(np.linspace(0, 1, 31), fps=30)
    assert order == list(range(31))
    for bad in ({"fps": 0}, {"fps": float("nan")}, {"fps": 30, "speed": -1}):
        with pytest.raises(InputError, match="fps and speed"):
            playing_order(times, **bad)


@pytest.mark.parametrize("seed", range(3))
def test_stretch_is_that_of_a_linear_map_however_it_is_turned(seed: int) -> None:
    rng = np.random.default_rng(seed)
    gradient = rng.normal(size=(3, 2))
    positions = MESH.material @ gradient.T
    expected = np.linalg.norm(gradient, 2)
    np.testing.assert_allclose(largest_stretch(SURFACE, positions), expected, rtol=1e-12)
    np.testing.assert_allclose(vertex_stretch(SURFACE, positions), expected, rtol=1e-12)


def flipping(index: int) -> Moment:
    """Flat cloth seen from above, its right side up, then its wrong side, then moved aside."""
    x, y = MESH.panel.T
    turned = np.column_stack([x if index != 1 else -x, y, 0 * x])
    return Moment(0.1 * index, turned + np.array([0.05 * (index == 2), 0, 0]), 0 * turned)


def test_sides_have_their_colours_and_the_camera_stands_still(drawing: None) -> None:
    animation = Animation(np.array([0, 0.1, 0.2]), flipping, SURFACE)
    with Film(animation, camera="top", size=(201, 151)) as film:
        pictures = [film.pixels(k).astype(int) for k in (0, 1, 2, 0)]
    assert pictures[0].shape == (150, 200, 3)
    np.testing.assert_array_equal(pictures[3], pictures[0])
    # Cloth covers x from -5 to 5 cm of the -5 to 10 cm that are in view.
    middle = [picture[75, 75] for picture in pictures]
    front, back = 255 * theme.rgb(theme.CLOTH_FRONT), 255 * theme.rgb(theme.CLOTH_BACK)
    for colour, near, far in ((middle[0], front, back), (middle[1], back, front), (middle[2], front, back)):
        assert _angle(colour, near) < 0.1 < _angle(colour, far)
    shares = [(picture.min(axis=2) < 230).mean() for picture in pictures]
    assert shares[2] == pytest.approx(shares[0], rel=0.05)
    columns = [np.flatnonzero(picture[75].min(axis=1) < 230).mean() for picture in pictures]
    assert columns[2] > columns[0] + 20


def _angle(colour: np.ndarray, other: np.ndarray) -> float:
    """Between two colours, whatever their brightness [rad]."""
    cosine = colour @ other / np.linalg.norm(colour) / np.linalg.norm(other)
    return float(np.arccos(np.clip(cosine, -1, 1)))


def test_stretch_has_one_scale_for_all_frames(drawing: None) -> None:
    def moment(index: int) -> Moment:
        return Moment(0.1 * index, np.column_stack([MESH.panel, 0 * MESH.panel[:, 0]]) * (1 + 0.1 * index))

    animation = Animation(np.array([0.0, 0.1]), moment, SURFACE)
    with Film(animation, colour="stretch", camera="top", size=(200, 150)) as film:
        first, last = (film.pixels(k)[75, 100].astype(float) for k in (0, 1))
    # Viridis from dark violet to yellow.
    assert first[2] > first[1] and last[0] > last[2] and last.sum() > first.sum()


def test_yarns_are_drawn_instead_of_the_cloth(drawing: None) -> None:
    points = np.array([[-0.05, 0, 0], [0, 0, 0], [0.05, 0, 0]])
    cloth = np.column_stack([MESH.panel, 0 * MESH.panel[:, 0]])
    radii = np.full(3, 5e-3)
    animation = Animation(
        np.zeros(1), lambda _: Moment(0.0, cloth, None, points, radii), SURFACE, CurveSet([0, 3], 5e-3)
    )
    with Film(animation, camera="top", size=(200, 150)) as film:
        picture = film.pixels(0).astype(int)
    assert _angle(picture[75, 100], 255 * theme.yarn_colour(0)) < 0.1
    assert (picture[75, 100] < 200).any() and (picture[130, 100] > 250).all()


def test_an_interrupted_film_keeps_what_was_drawn(drawing: None, tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    animation = Animation(np.array([0, 0.1, 0.2]), flipping, SURFACE)

    def stop(done: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    path = tmp_path / "film.mp4"
    with pytest.raises(KeyboardInterrupt, match=r"film.mp4 holds 2 of 3 frames"):
        write_movie(path, animation, fps=10, size=(200, 150), on_frame=stop)
    with av.open(str(path)) as film:
        assert sum(1 for _ in film.decode(video=0)) == 1
    assert list(tmp_path.iterdir()) == [path]


def test_yarns_from_afar_take_few_vertices_and_keep_their_width(drawing: None) -> None:
    angles = np.linspace(0, 60, 600)
    points = np.column_stack([0.02 * angles / 60, 1e-3 * np.sin(angles), 1e-3 * np.cos(angles)])
    curves = CurveSet([0, 600], 1e-3)
    far, near = (seen_tubes(curves, points, scale)[0] for scale in (500.0, 50_000.0))
    assert far.sides == 3 and near.sides == 20
    assert 5 * far.curves.point_count < near.curves.point_count <= 600
    straight = CurveSet([0, 2], 1e-3)
    for sides in (3, 4, 8, 20):
        ring = TubeSweep(straight, sides=sides).surface(np.array([[0.0, 0, 0], [0, 0, 1]]), straight.radii)
        vertices = ring[0][:sides]
        round_ = np.linspace(0, np.pi, 721)
        widths = np.ptp(vertices[:, :2] @ np.stack([np.cos(round_), np.sin(round_)]), axis=0)
        assert widths.mean() == pytest.approx(2e-3, rel=1e-3)


def test_nothing_to_draw_is_an_error() -> None:
    with pytest.raises(InputError, match="something to draw"):
        Film(Animation(np.zeros(1), lambda _: Moment(0.0)))
    bare = Animation(np.zeros(1), lambda _: Moment(0.0, np.zeros((3, 3))), Surface(np.array([[0, 1, 2]])))
    with pytest.raises(InputError, match="material coordinates"):
        Film(bare, colour="stretch")

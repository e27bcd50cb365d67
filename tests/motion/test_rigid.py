"""Prescribed rigid motions: where they begin and end."""

from __future__ import annotations

from yarnscale.motion.rigid import Motion


def test_a_motion_without_duration_jumps_at_its_start() -> None:
    motion = Motion((0.1, 0.0, 0.0), 1.0)
    assert [motion.share(time) for time in (0.0, 0.5, 1.0, 2.0)] == [0.0, 0.0, 1.0, 1.0]

"""A compass that sticks at one value while no gyro measures turns: the courses tell, and a sound one is let be."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator

import pytest

from acquisition.sample import COMPASS, IMU, CompassSample, GpsSample, ImuSample, Sample
from tinyekf_py import Estimate, HeadingFusion
from tinyekf_py.fusion import METHODS

NAN = math.nan
STUCK_AT_DEG = 40.0

#: North and east over ground, m/s, at a time, s.
Velocity = Callable[[float], tuple[float, float]]


def turning(t_s: float) -> float:
    """Heading, degrees, of a boat that turns by 90 degrees at 20 s and comes back at 60 s."""
    return STUCK_AT_DEG + min(max(0.0, 6.0 * (t_s - 20.0)), 90.0) - min(max(0.0, 6.0 * (t_s - 60.0)), 90.0)


def ahead(t_s: float) -> tuple[float, float]:
    heading = math.radians(turning(t_s))
    return 4.0 * math.cos(heading), 4.0 * math.sin(heading)


def boat(
    seconds: float,
    velocity: Velocity = ahead,
    *,
    shown: Callable[[float], float] = lambda t_s: STUCK_AT_DEG,
    gyro_until_s: float = 0.0,
    bent: Callable[[GpsSample], GpsSample | None] = lambda sample: sample,
    hdop: float = 1.0,
) -> Iterator[Sample]:
    """Three receivers at 5 Hz, a compass at 10 Hz that shows `shown`, for a while a gyro."""
    chance = random.Random(1)
    north = east = 0.0
    errors = [(0.0, 0.0)] * 3
    for tick in range(int(seconds * 100)):
        t_s, t_us = tick / 100, tick * 10_000
        v = velocity(t_s)
        north, east = north + v[0] / 100, east + v[1] / 100
        if t_s < gyro_until_s:
            rate = (turning(t_s + 0.01) - turning(t_s)) / 0.01
            yield ImuSample(t_us, IMU, 0, 0, 0, 0, 0, 0, rate, 0, 0, 1 + 1e-3 * (tick % 2))
        for i in range(3):
            if tick % 20 == 5 + i:
                sigma = 0.04 * hdop
                errors[i] = (0.8 * errors[i][0] + chance.gauss(0, sigma), 0.8 * errors[i][1] + chance.gauss(0, sigma))
                x, y = v[0] + errors[i][0], v[1] + errors[i][1]
                place = 36 + north / 110_950, 126 + east / 90_000
                course = math.degrees(math.atan2(y, x)) % 360.0
                sample = bent(GpsSample(t_us, i, 2, 1.79e9 + t_s, *place, 0, math.hypot(x, y), course, hdop))
                if sample is not None:
                    yield sample
        if tick % 10 == 8:
            yield CompassSample(t_us, COMPASS, 1, shown(t_s))


def sailed(
    samples: Iterator[Sample], method: str = "adaptive", *aboard: str, n_gps: int = 3
) -> tuple[HeadingFusion, list[Estimate]]:
    fusion = HeadingFusion(method, n_gps=n_gps, sources=("compass", *aboard))
    return fusion, fusion.feed_records(b"".join(sample.pack() for sample in samples))


def noticed_s(rows: list[Estimate]) -> float:
    """When the mode fell first, after the start; infinite: never."""
    return min((row.t_us / 1e6 for row in rows if row.t_us > 2e6 and row.mode != "ok"), default=math.inf)


@pytest.mark.parametrize("method", METHODS)
def test_it_is_noticed_soon_after_the_turn_began_and_believed_as_soon_as_it_moves(method: str) -> None:
    shown = lambda t_s: STUCK_AT_DEG if t_s < 50.0 else turning(t_s) + 0.1 * (t_s * 10 // 1 % 2)  # noqa: E731
    fusion, rows = sailed(boat(80.0, shown=shown), method)
    assert 23.0 < noticed_s(rows) < 32.0
    assert {row.mode for row in rows if noticed_s(rows) <= row.t_us / 1e6 <= 50.0} == {"degraded"}
    assert {row.mode for row in rows if row.t_us / 1e6 > 50.3} == {"ok"}
    assert "sticks at one value" in fusion.take_notices()[0]


def test_the_heading_comes_back_to_the_course_at_once_and_its_sigma_covers_it() -> None:
    _, rows = sailed(boat(60.0))
    noticed = noticed_s(rows)
    for row in rows:
        t_s = row.t_us / 1e6
        if t_s > noticed + 2.0:
            error = abs(math.remainder(row.heading_deg - turning(t_s), 360.0))
            assert error < 8.0
            assert error < 4.0 * row.heading_sigma_deg


@pytest.mark.parametrize("method", METHODS)
def test_it_is_noticed_when_the_gyro_dies(method: str) -> None:
    fusion, rows = sailed(boat(19.0, gyro_until_s=12.0), method, "imu")
    assert {row.mode for row in rows if 2.0 < row.t_us / 1e6 < 12.0} == {"ok"}
    assert fusion.verdicts["stuck"] == 0
    fusion, _ = sailed(boat(60.0, gyro_until_s=12.0), method, "imu")
    assert fusion.verdicts["stuck"] > 200


def test_positions_alone_tell_as_much() -> None:
    _, rows = sailed(boat(60.0, bent=lambda s: s._replace(speed_mps=NAN, course_deg=NAN)))
    assert 23.0 < noticed_s(rows) < 36.0


def test_one_receiver_is_enough_when_it_is_the_only_one() -> None:
    _, rows = sailed(boat(60.0, bent=lambda s: s if s.source == 0 else None), n_gps=1)
    assert 23.0 < noticed_s(rows) < 32.0


def straight(t_s: float, speed_mps: float, current: tuple[float, float] = (0.0, 0.0)) -> tuple[float, float]:
    heading = math.radians(STUCK_AT_DEG)
    return speed_mps * math.cos(heading) + current[0], speed_mps * math.sin(heading) + current[1]


def at_the_quay(t_s: float) -> tuple[float, float]:
    return 0.0, 0.0


def astern_and_ahead(t_s: float) -> tuple[float, float]:
    return straight(t_s, 3.0 * math.sin(t_s / 10.0))


def stops_in_a_stream(t_s: float) -> tuple[float, float]:
    return straight(t_s, max(0.0, 4.0 - 0.2 * max(0.0, t_s - 30.0)), (-0.8, 1.0))


def casts_off_into_a_stream(t_s: float) -> tuple[float, float]:
    return (0.0, 0.0) if t_s < 30.0 else (-1.2, 0.0)


def enters_a_stream(t_s: float) -> tuple[float, float]:
    flow = min(max(0.0, (t_s - 30.0) / 20.0), 1.0)
    return straight(t_s, 3.0, (-0.6 * flow, 0.6 * flow))


def rolls(t_s: float) -> tuple[float, float]:
    sway, heading = 1.5 * math.sin(1.2 * t_s), math.radians(STUCK_AT_DEG)
    return straight(t_s, 3.0, (-sway * math.sin(heading), sway * math.cos(heading)))


@pytest.mark.parametrize("hdop", [0.8, 3.0])
@pytest.mark.parametrize(
    "velocity",
    [at_the_quay, astern_and_ahead, stops_in_a_stream, casts_off_into_a_stream, enters_a_stream, rolls],
)
def test_a_sound_compass_that_repeats_itself_is_believed(velocity: Velocity, hdop: float) -> None:
    fusion, _ = sailed(boat(150.0, velocity, hdop=hdop))
    assert fusion.verdicts["stuck"] == 0


def test_a_compass_of_whole_degrees_is_believed_in_waves_and_turns() -> None:
    yaw = lambda t_s: turning(t_s) + 1.5 * math.sin(t_s)  # noqa: E731
    fusion, _ = sailed(boat(90.0, shown=lambda t_s: round(yaw(t_s)) % 360.0))
    assert fusion.verdicts["stuck"] == 0


@pytest.mark.parametrize("off_deg", [-20.0, 15.0])
def test_a_compass_mounted_askew_is_believed_when_the_speed_changes(off_deg: float) -> None:
    fusion, _ = sailed(boat(150.0, astern_and_ahead, shown=lambda t_s: STUCK_AT_DEG + off_deg))
    assert fusion.verdicts["stuck"] == 0


def test_a_black_out_makes_no_compass_stuck() -> None:
    dark = lambda s: None if 30.0 < s.t_us / 1e6 < 60.0 else s  # noqa: E731
    fusion, _ = sailed(boat(100.0, lambda t_s: straight(t_s, 4.0), bent=dark))
    assert fusion.verdicts["stuck"] == 0


@pytest.mark.parametrize("n_gps", [2, 3])
def test_one_receiver_that_lies_condemns_no_compass(n_gps: int) -> None:
    def bent(sample: GpsSample) -> GpsSample | None:
        lies = sample.source == 0 and sample.t_us > 20e6
        return None if sample.source >= n_gps else sample._replace(course_deg=170.0) if lies else sample

    fusion, _ = sailed(boat(60.0, lambda t_s: straight(t_s, 4.0), bent=bent), n_gps=n_gps)
    assert fusion.verdicts["stuck"] == 0

"""What each sensor last said: taken over as it is, corrected where it must be, and missing once it is silent."""

from __future__ import annotations

import math
from typing import Any

import pytest

from acquisition.device import DeviceState
from acquisition.sample import COMPASS, IMU, REFERENCE_TRUE, SOURCES, CompassSample, GpsSample, ImuSample, Sample
from tinyekf_py.fusion import HeadingFusion
from tinyekf_py.instruments import Instruments

NAN = float("nan")
UTC_S = 1_795_550_355.0


class Boat:
    """A fusion and its instruments, fed alike."""

    def __init__(self, **options: Any) -> None:
        self.fusion = HeadingFusion(**options)
        self.instruments = Instruments(self.fusion)

    def say(self, *samples: Sample) -> None:
        for sample in samples:
            name = next(name for name, number in SOURCES.items() if number == sample.source)
            self.fusion.feed_records(sample.pack())
            self.instruments.take(name, sample.pack())


def gps(t_us: int, number: int = 1, **changes: Any) -> GpsSample:
    usual = GpsSample(t_us, number - 1, 1, UTC_S + t_us / 1e6, 54.0, 10.0, 3.0, 4.0, 80.0, 1.0, NAN, 9)
    return usual._replace(**changes)


def test_a_receiver_that_lies_still_has_no_course() -> None:
    boat = Boat(variation_deg=0.0)
    boat.say(gps(0, 1), gps(0, 2, speed_mps=0.3))
    moving, still = (boat.instruments.sensor_row(name, 0) for name in ("gps1", "gps2"))
    assert (moving.heading_deg, moving.fix_quality, moving.hdop, moving.weight) == (80.0, 1, 1.0, 2.0)
    assert 1.0 < moving.heading_sigma_deg < 20.0
    assert math.isnan(still.heading_deg)
    assert math.isnan(still.heading_sigma_deg)


def test_a_slower_boat_has_a_less_certain_course() -> None:
    fusion = HeadingFusion()
    fast, slow = (fusion.course_sigma_deg(speed_mps, 1.0, 3.0) for speed_mps in (5.0, 1.0))
    assert slow > 3 * fast
    assert fusion.course_sigma_deg(5.0, 4.0, 1.0) > fast
    assert math.isnan(fusion.course_sigma_deg(5.0, 1.0, 0.0))


def test_the_compass_is_corrected_by_deviation_and_variation() -> None:
    boat = Boat(variation_deg=-8.0, deviation_deg=(1.0, 0.0, 2.0, 0.0, 0.0))
    boat.say(CompassSample(0, COMPASS, heading_deg=0.0))
    assert boat.instruments.sensor_row("compass", 0).heading_deg == pytest.approx(355.0)
    navigation = boat.instruments.navigation(0, 0)
    assert navigation.deviation_deg == pytest.approx(3.0)
    assert navigation.variation_deg == pytest.approx(-8.0)


def test_a_compass_that_is_true_has_no_deviation_and_one_that_tells_variation_is_believed() -> None:
    boat = Boat(variation_deg="auto")
    boat.say(CompassSample(0, COMPASS, REFERENCE_TRUE, 12.0))
    assert boat.instruments.sensor_row("compass", 0).heading_deg == pytest.approx(12.0)
    assert math.isnan(boat.instruments.navigation(0, 0).deviation_deg)
    boat.say(CompassSample(100_000, COMPASS, heading_deg=10.0, deviation_deg=-1.5, variation_deg=4.0))
    navigation = boat.instruments.navigation(100_000, 100_000)
    assert (navigation.variation_deg, navigation.deviation_deg) == (pytest.approx(4.0), pytest.approx(-1.5))
    assert boat.instruments.sensor_row("compass", 100_000).heading_deg == pytest.approx(12.5)


def test_navigation_follows_the_best_receiver_and_stays_with_it() -> None:
    boat = Boat(variation_deg=0.0)
    boat.say(gps(0, 1, speed_mps=1.0), gps(0, 2, fix_quality=2, speed_mps=2.0), gps(0, 3, fix_quality=2, speed_mps=3.0))
    assert boat.instruments.navigation(0, 0).sog_mps == 2.0
    boat.say(gps(100_000, 3, fix_quality=2, speed_mps=3.0, hdop=0.6))
    assert boat.instruments.navigation(100_000, 100_000).sog_mps == 2.0  # no better: both have weight 3
    boat.say(gps(200_000, 2, fix_quality=1, speed_mps=2.0))
    assert boat.instruments.navigation(200_000, 200_000).sog_mps == 3.0
    boat.say(gps(300_000, 2, fix_quality=2), gps(300_000, 3, fix_quality=0), gps(300_000, 1, fix_quality=0))
    assert boat.instruments.navigation(300_000, 300_000).fix_quality == 2


def test_what_is_silent_is_missing() -> None:
    boat = Boat(variation_deg=0.0)
    boat.say(gps(0), CompassSample(0, COMPASS, heading_deg=5.0, pitch_deg=1.0, roll_deg=2.0))
    at = 60_000_000
    navigation = boat.instruments.navigation(at, at)
    assert (navigation.fix_quality, navigation.satellites) == (-1, -1)
    for value in (navigation.sog_mps, navigation.cog_deg, navigation.roll_deg, navigation.deviation_deg):
        assert math.isnan(value)
    for name in ("gps1", "compass"):
        row = boat.instruments.sensor_row(name, at)
        assert row.age_s == pytest.approx(60.0)
        assert math.isnan(row.heading_deg)
        assert math.isnan(row.weight)
    assert navigation.utc_s == pytest.approx(UTC_S + 60.0)  # our own clock carries it on
    assert math.isnan(boat.instruments.sensor_row("gps2", at).age_s)


def test_a_receiver_without_a_fix_weighs_nothing_and_navigates_nobody() -> None:
    boat = Boat(variation_deg=0.0)
    boat.say(gps(0, fix_quality=0, lat_deg=NAN, lon_deg=NAN))
    row = boat.instruments.sensor_row("gps1", 0)
    assert (row.fix_quality, row.weight) == (0, 0.0)
    assert math.isnan(row.heading_deg)
    assert math.isnan(boat.instruments.navigation(0, 0).sog_mps)


def test_attitude_is_the_imus_in_the_boats_axes_else_the_compass() -> None:
    boat = Boat(variation_deg=0.0, mount_deg=(0.0, 0.0, 90.0))
    boat.say(CompassSample(0, COMPASS, heading_deg=5.0, pitch_deg=1.0, roll_deg=2.0))
    navigation = boat.instruments.navigation(0, 0)
    assert (navigation.roll_deg, navigation.pitch_deg) == (2.0, 1.0)
    tilt = math.radians(10.0)
    boat.say(
        ImuSample(1000, IMU, 0, NAN, NAN, NAN, 0.0, 0.0, 0.0, math.sin(tilt), 0.0, math.cos(tilt)),
    )
    navigation = boat.instruments.navigation(1000, 1000)
    assert navigation.roll_deg == pytest.approx(10.0)
    assert navigation.pitch_deg == pytest.approx(0.0, abs=1e-9)


def test_a_device_adds_what_its_port_knows() -> None:
    boat = Boat(variation_deg=0.0)
    boat.say(gps(0))
    state = DeviceState("gps1", True, "open", "/dev/pts/7", 42, 3, measured_hz=9.9, last_error="checksum")
    state.counts.update(lines=100, samples=33, checksum=2, down_ms=1500)
    row = boat.instruments.device_row(state, 50_000)
    assert (row.port_state, row.port_text, row.restarts, row.rate_hz) == ("open", "/dev/pts/7", 3, 9.9)
    assert (row.lines, row.samples, row.errors, row.dropped, row.down_s) == (100, 33, 2, (("checksum", 2),), 1.5)
    state.polling = False
    assert boat.instruments.device_row(state, 50_000).port_state == "stopped"

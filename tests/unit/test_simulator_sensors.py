"""What the simulated devices print, against the truth, and the size and kind of their errors."""

from __future__ import annotations

import itertools
import math
import statistics
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime
from typing import Any

import pynmea2
import pytest

from acquisition.simulator.compass import deviation_at
from acquisition.simulator.faults import Disturbance, Jumps, NoFix, Silence
from acquisition.simulator.grades import GRADES, CompassGrade, GpsGrade, Grade, ImuGrade
from acquisition.simulator.helm import Leg
from acquisition.simulator.nmea import angle_field
from acquisition.simulator.scenarios import SCENARIOS, Scenario
from acquisition.simulator.vessel import Sea, Waters
from acquisition.simulator.voyage import ANTENNAS_M, START_UTC, Arrival, Voyage

#: Devices without a fault of their own: what they print is the truth, but for their resolution.
PERFECT = Grade(
    GpsGrade(
        shared_m=0.0, own_m=0.0, white_m=0.0, velocity_mps=0.0, latency_s=(0.1, 0.1), jitter_s=0.0, hdop_spread=0.0
    ),
    CompassGrade(
        deviation_deg=(1.5, 2.5, -2.0, 1.0, 0.7), lag_s=1e-3, jitter_s=0.0, white_deg=0.0, slow_deg=0.0, tilt_deg=0.0
    ),
    ImuGrade(
        bias_dps=0.0,
        warm_up_dps=0.0,
        wander_dps=0.0,
        noise_dps=0.0,
        scale=0.0,
        accel_bias_g=0.0,
        accel_noise_g=0.0,
        jitter_s=0.0,
    ),
)
TURNING = Scenario("turning", "", (Leg(600.0, turn_dps=6.0),), 200.0, 5.0, Waters(sea=Sea(roll_deg=3.0)))
MPS_PER_KNOT = 1852 / 3600
METRES_PER_DEGREE = 111_000.0


def arrivals(voyage: Voyage, seconds: float) -> Iterator[Arrival]:
    for _ in range(round(seconds * 100)):
        yield from voyage.advance()


def sentences(voyage: Voyage, seconds: float, source: str, kind: str) -> list[Any]:
    return [
        pynmea2.parse(arrival.line.decode(), check=True)
        for arrival in arrivals(voyage, seconds)
        if arrival.source == source and arrival.line[3:6] == kind.encode()
    ]


def truth(scenario: Scenario, seconds: float, seed: int = 1) -> list[tuple[float, float, float, float, float]]:
    """(heading_deg, lat_deg, lon_deg, north_mps, east_mps) at every 10 ms step."""
    voyage = Voyage(replace(scenario, devices=()), PERFECT, seed=seed)
    rows = []
    for _ in range(round(seconds * 100) + 1):
        m = voyage.motion
        rows.append((m.heading_deg, m.lat_deg, m.lon_deg, m.north_mps, m.east_mps))
        voyage.advance()
    return rows


def wrapped(degrees: float) -> float:
    return math.remainder(degrees, 360.0)


@pytest.mark.parametrize("grade", GRADES)
def test_every_sentence_has_its_checksum_and_prints_as_it_parses(grade: str) -> None:
    scenario = replace(SCENARIOS["tour"], faults=(NoFix(5.0, 6.0),))
    kinds = set()
    for arrival in arrivals(Voyage(scenario, GRADES[grade], seed=3), 20.0):
        if arrival.source != "imu":
            message = pynmea2.parse(arrival.line.decode(), check=True)
            kinds.add(message.sentence_type)
            assert str(message).encode() == arrival.line
    assert kinds == {"GGA", "GSA", "RMC", "HDM", "XDR"}


def test_positions_are_the_antennas_within_the_resolution_of_the_sentence() -> None:
    scenario = replace(TURNING, waters=Waters())
    rows = truth(scenario, 20.0)
    for source, (forward_m, starboard_m, _) in ANTENNAS_M.items():
        for fix in sentences(Voyage(scenario, PERFECT), 20.0, source, "GGA"):
            heading_deg, lat_deg, lon_deg, *_ = rows[
                round((fix.timestamp.second + fix.timestamp.microsecond / 1e6) * 100)
            ]
            heading = math.radians(heading_deg)
            north_m = forward_m * math.cos(heading) - starboard_m * math.sin(heading)
            east_m = forward_m * math.sin(heading) + starboard_m * math.cos(heading)
            # Heeling in the turn swings the antennas' height by some decimetres more.
            assert (fix.latitude - lat_deg) * METRES_PER_DEGREE == pytest.approx(north_m, abs=0.25)
            assert (fix.longitude - lon_deg) * 90_200.0 == pytest.approx(east_m, abs=0.25)


def test_speed_and_course_are_those_of_the_moving_antenna() -> None:
    fixes = sentences(Voyage(TURNING, PERFECT), 30.0, "gps1", "RMC")
    for before, now, after in zip(fixes[:-10], fixes[5:-5], fixes[10:], strict=True):
        north_mps = (after.latitude - before.latitude) * 110_960.0
        east_mps = (after.longitude - before.longitude) * 90_180.0
        speed_mps = now.spd_over_grnd * MPS_PER_KNOT
        assert speed_mps == pytest.approx(math.hypot(north_mps, east_mps), abs=0.12)
        assert wrapped(now.true_course - math.degrees(math.atan2(east_mps, north_mps))) == pytest.approx(0.0, abs=2.0)


def test_speed_and_course_round_to_the_sentence() -> None:
    scenario = replace(SCENARIOS["straight"], waters=Waters(leeway_deg=0.0))
    fix = sentences(Voyage(scenario, PERFECT), 1.0, "gps3", "RMC")[0]
    assert fix.spd_over_grnd * MPS_PER_KNOT == pytest.approx(5.0, abs=0.0003)
    assert fix.true_course == pytest.approx(18.01)
    assert fix.datestamp == START_UTC.date()


def test_course_never_prints_360() -> None:
    scenario = replace(
        SCENARIOS["straight"], plan=(Leg(9.0, 359.998),), heading_deg=359.998, waters=Waters(leeway_deg=0.0)
    )
    assert {fix.data[7] for fix in sentences(Voyage(scenario, PERFECT), 2.0, "gps1", "RMC")} == {"0.00"}


def test_course_is_blank_at_the_dock() -> None:
    fixes = sentences(Voyage(SCENARIOS["dock"], GRADES["good"]), 20.0, "gps1", "RMC")
    assert sum(fix.true_course is None for fix in fixes) > 0.9 * len(fixes)
    assert all(fix.status == "A" for fix in fixes)


def test_minutes_carry_into_degrees() -> None:
    assert angle_field(35.9999999999, 2) == "3600.00000"
    assert angle_field(-126.52, 3) == "12631.20000"


@pytest.mark.parametrize("grade", GRADES)
def test_closing_sentence_comes_with_the_latency_of_a_receiver(grade: str) -> None:
    voyage = Voyage(SCENARIOS["tour"], GRADES[grade], seed=11)
    for arrival in arrivals(voyage, 10.0):
        if arrival.line[3:6] == b"RMC":
            fix: Any = pynmea2.parse(arrival.line.decode())
            sensed_s = (datetime.combine(START_UTC.date(), fix.timestamp) - START_UTC).total_seconds()
            assert 0.06 <= arrival.t_us / 1e6 - sensed_s <= 0.25


def test_gps_errors_are_correlated_in_time_and_shared_between_receivers() -> None:
    apart, own, later = [], [], []
    for seed in range(6):
        scenario = replace(SCENARIOS["dock"], devices=("gps1", "gps2"))
        north: dict[str, list[float]] = {"gps1": [], "gps2": []}
        for arrival in arrivals(Voyage(scenario, GRADES["typical"], seed=seed), 60.0):
            if arrival.line[3:6] == b"GGA":
                fix: Any = pynmea2.parse(arrival.line.decode())
                north[arrival.source].append((fix.latitude - scenario.waters.lat_deg) * METRES_PER_DEGREE)
        own += [x**2 for x in north["gps1"]]
        apart += [(x - y) ** 2 for x, y in zip(north["gps1"], north["gps2"], strict=False)]
        later += [(x - y) ** 2 for x, y in zip(north["gps1"], north["gps1"][100:], strict=False)]
    assert 0.3 < math.sqrt(statistics.fmean(own)) < 3.0
    assert statistics.fmean(later) < 0.1 * statistics.fmean(own)  # ten seconds later it is still much the same
    assert statistics.fmean(apart) < 2.0 * 0.75 * statistics.fmean(
        own
    )  # independent ones would differ by twice their own


@pytest.mark.parametrize(
    ("grade", "least", "most"), [("good", 0.03, 0.07), ("typical", 0.06, 0.13), ("poor", 0.1, 0.25)]
)
def test_velocity_noise_has_the_size_of_its_grade(grade: str, least: float, most: float) -> None:
    scenario = replace(SCENARIOS["straight"], plan=(Leg(600.0, 0.0),), heading_deg=0.0, waters=Waters(leeway_deg=0.0))
    fixes = sentences(Voyage(replace(scenario, devices=("gps1",)), GRADES[grade], seed=2), 60.0, "gps1", "RMC")
    across = [fix.spd_over_grnd * MPS_PER_KNOT * math.sin(math.radians(fix.true_course)) for fix in fixes]
    assert least < statistics.pstdev(across) < most


def test_fix_quality_and_hdop_change_slowly() -> None:
    scenario = replace(SCENARIOS["straight"], devices=("gps1",))
    fixes = sentences(Voyage(scenario, GRADES["poor"], seed=1), 400.0, "gps1", "GGA")
    assert {fix.gps_qual for fix in fixes} == {1, 2}
    hdops = [float(fix.horizontal_dil) for fix in fixes]
    assert max(hdops) > 1.1 * min(hdops)
    assert max(abs(a - b) for a, b in itertools.pairwise(hdops)) < 0.2


def test_compass_plus_deviation_plus_variation_is_the_heading() -> None:
    scenario = replace(TURNING, waters=Waters(variation_deg=-8.0))
    rows = truth(scenario, 70.0)
    voyage = Voyage(scenario, PERFECT)
    readings = sentences(voyage, 70.0, "compass", "HDM")
    for number, reading in enumerate(readings):
        shown_deg = float(reading.heading)
        heading_deg = shown_deg + deviation_at(voyage.compass.deviation_deg, shown_deg) - 8.0
        assert wrapped(heading_deg - rows[number * 10 + 3][0]) == pytest.approx(0.0, abs=0.06)
    assert max(abs(wrapped(float(r.heading) - 8.0 - rows[i * 10 + 3][0])) for i, r in enumerate(readings)) > 2.0


def test_deviation_has_the_terms_of_its_coefficients() -> None:
    assert deviation_at((1.0, 0, 0, 0, 0), 123.0) == pytest.approx(1.0)
    assert deviation_at((0, 2.0, 0, 0, 0), 90.0) == pytest.approx(2.0)
    assert deviation_at((0, 0, 3.0, 0, 0), 180.0) == pytest.approx(-3.0)
    assert deviation_at((0, 0, 0, 4.0, 0), 45.0) == pytest.approx(4.0)
    assert deviation_at((0, 0, 0, 0, 5.0), 90.0) == pytest.approx(-5.0)


def test_compass_lags_behind_a_turn() -> None:
    grade = replace(PERFECT, compass=replace(PERFECT.compass, deviation_deg=(0.0,) * 5, lag_s=0.3))
    scenario = replace(TURNING, waters=Waters(variation_deg=0.0))
    last = sentences(Voyage(scenario, grade), 30.0, "compass", "HDM")[-1]
    behind_deg = wrapped(truth(scenario, 30.0)[2993][0] - float(last.heading))
    assert behind_deg == pytest.approx(6.0 * 0.3, abs=0.4)


def test_imu_prints_the_motion_in_body_axes() -> None:
    scenario = replace(TURNING, waters=Waters(sea=Sea(roll_deg=4.0, pitch_deg=2.0, yaw_deg=1.0)))
    voyage = Voyage(scenario, PERFECT)
    expected = []
    printed = []
    for _ in range(1000):
        motion = voyage.motion
        rates = tuple(map(math.degrees, motion.body_rates()))
        expected.append((*rates, *motion.body_gravity()))
        printed += [arrival.line for arrival in voyage.advance() if arrival.source == "imu"]
    for line, values in zip(printed, expected, strict=False):
        fields = line.removeprefix(b"*").split(b",")
        assert len(fields) == 9
        assert [float(field) for field in fields[3:6]] == pytest.approx(values[:3], abs=0.0051)
        assert [float(field) for field in fields[6:]] == pytest.approx(values[3:], abs=0.00051)


def test_gyro_bias_shows_at_rest_and_drifts_slowly() -> None:
    scenario = replace(SCENARIOS["dock"], devices=("imu",), waters=Waters())
    voyage = Voyage(scenario, GRADES["typical"], seed=4)
    start_dps = voyage.imu.bias_dps[2]
    rates = [float(arrival.line.split(b",")[5]) for arrival in arrivals(voyage, 120.0)]
    assert 0.2 < abs(start_dps) < 0.8
    assert statistics.fmean(rates[:500]) == pytest.approx(start_dps, abs=0.03)
    assert 0.0 < abs(voyage.imu.bias_dps[2] - start_dps) < 0.2


def lines_by_source(scenario: Scenario, seconds: float = 30.0) -> dict[str, list[bytes]]:
    lines: dict[str, list[bytes]] = {source: [] for source in scenario.devices}
    for arrival in arrivals(Voyage(scenario, GRADES["typical"], seed=5), seconds):
        lines[arrival.source].append(arrival.line)
    return lines


def test_a_receiver_without_a_fix_prints_that_it_has_none() -> None:
    scenario = replace(SCENARIOS["straight"], faults=(NoFix(0.0),))
    voyage = Voyage(scenario, GRADES["typical"])
    rest = sentences(voyage, 2.0, "gps2", "RMC")
    assert rest
    assert all(fix.status == "V" and fix.data[2:8] == [""] * 6 for fix in rest)
    assert all(fix.gps_qual == 0 for fix in sentences(voyage, 1.0, "gps2", "GGA"))


def test_a_fault_changes_nothing_but_its_own_sensor_in_its_own_time() -> None:
    healthy = lines_by_source(SCENARIOS["straight"])
    for fault, source in [
        (Jumps(10.0, 20.0, ("gps2",)), "gps2"),
        (NoFix(10.0, 20.0, ("gps2",)), "gps2"),
        (Disturbance(10.0, 20.0), "compass"),
        (Silence(10.0, 20.0, ("imu",)), "imu"),
    ]:
        faulty = lines_by_source(replace(SCENARIOS["straight"], faults=(fault,)))
        assert [name for name in healthy if healthy[name] != faulty[name]] == [source]
        hertz = len(healthy[source]) // 30
        assert faulty[source][: 9 * hertz] == healthy[source][: 9 * hertz]
        if source != "gps2" or isinstance(fault, NoFix):
            assert faulty[source][-9 * hertz :] == healthy[source][-9 * hertz :]


def test_jumps_are_25_metres_with_good_hdop() -> None:
    healthy = sentences(Voyage(SCENARIOS["straight"], GRADES["typical"]), 60.0, "gps2", "GGA")
    scenario = replace(SCENARIOS["straight"], faults=(Jumps(5.0, sources=("gps2",)),))
    jumping = sentences(Voyage(scenario, GRADES["typical"]), 60.0, "gps2", "GGA")
    offsets_m = set()
    for good, bad in zip(healthy, jumping, strict=True):
        north_m = (bad.latitude - good.latitude) * 110_960.0
        east_m = (bad.longitude - good.longitude) * 90_230.0
        offsets_m.add(round(math.hypot(north_m, east_m)))
        assert (bad.gps_qual, bad.horizontal_dil) == (good.gps_qual, good.horizontal_dil)
    assert offsets_m == {0, 25}


def test_magnetic_disturbance_comes_and_goes_with_a_ramp() -> None:
    fault = Disturbance(10.0, 30.0, offset_deg=35.0, ramp_s=4.0)
    assert [fault.offset_at(t_s) for t_s in (9.9, 10.0, 12.0, 14.0, 20.0, 28.0, 30.0)] == [0, 0, 17.5, 35, 35, 17.5, 0]

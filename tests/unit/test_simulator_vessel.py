"""The simulated boat against physics reached by other roads: geocentric coordinates, rotation matrices, geometry."""

from __future__ import annotations

import math
import statistics

import pytest

from acquisition.simulator.helm import Helm, Leg, circle, zigzag
from acquisition.simulator.scenarios import SCENARIOS, scenario_named, settled
from acquisition.simulator.vessel import STEP_S, Motion, Sea, Vessel, Waters

Vector = tuple[float, float, float]

ROUGH = Sea(roll_deg=5.0, pitch_deg=2.0, yaw_deg=1.0, surge_mps=0.1, sway_mps=0.1, heave_mps=0.2)
CALM = Waters(leeway_deg=0.0)


def sail(vessel: Vessel, seconds: float) -> list[tuple[float, ...]]:
    """Rows of (heading_rad, lat_deg, lon_deg, north_mps, east_mps, yaw_rate) at 100 Hz."""
    rows: list[tuple[float, ...]] = []
    for _ in range(round(seconds / STEP_S)):
        vessel.advance()
        m = vessel.motion
        rows.append((m.heading_rad, m.lat_deg, m.lon_deg, m.north_mps, m.east_mps, m.yaw_rate))
    return rows


def boat(*plan: Leg, waters: Waters = CALM, heading_deg: float = 0.0, speed_mps: float = 5.0) -> Vessel:
    return Vessel(plan, waters, heading_deg=heading_deg, speed_mps=speed_mps, seed=7)


def drift_angle_deg(row: tuple[float, ...]) -> float:
    """Course over ground minus heading."""
    course = math.atan2(row[4], row[3])
    return math.degrees(math.remainder(course - row[0], math.tau))


def geocentric(lat_deg: float, lon_deg: float) -> Vector:
    lat, lon = math.radians(lat_deg), math.radians(lon_deg)
    e2 = 0.0818191908426**2
    n = 6378137.0 / math.sqrt(1 - e2 * math.sin(lat) ** 2)
    return (
        n * math.cos(lat) * math.cos(lon),
        n * math.cos(lat) * math.sin(lon),
        n * (1 - e2) * math.sin(lat),
    )


def test_positions_differ_by_the_velocity() -> None:
    waters = Waters(set_deg=70.0, drift_mps=0.6, sea=ROUGH)
    rows = sail(boat(circle(6.0), waters=waters), 60.0)
    for before, now, after in list(zip(rows, rows[1:], rows[2:], strict=False))[::37]:
        lat, lon = math.radians(now[1]), math.radians(now[2])
        dx, dy, dz = (a - b for a, b in zip(geocentric(*after[1:3]), geocentric(*before[1:3]), strict=True))
        east = -math.sin(lon) * dx + math.cos(lon) * dy
        north = -math.sin(lat) * (math.cos(lon) * dx + math.sin(lon) * dy) + math.cos(lat) * dz
        assert north / (2 * STEP_S) == pytest.approx(now[3], abs=2e-3)
        assert east / (2 * STEP_S) == pytest.approx(now[4], abs=2e-3)


def attitude_matrix(motion: Motion) -> list[Vector]:
    """Rows: the earth's north, east, down of body x, y, z."""
    r, p, y = motion.roll_rad, motion.pitch_rad, motion.heading_rad
    cr, sr, cp, sp, cy, sy = math.cos(r), math.sin(r), math.cos(p), math.sin(p), math.cos(y), math.sin(y)
    return [
        (cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy),
        (cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy),
        (-sp, sr * cp, cr * cp),
    ]


def turned(matrix: list[Vector], rates: Vector) -> list[Vector]:
    """`matrix` after one step of turning about its own axes (Rodrigues)."""
    angle = math.hypot(*rates) * STEP_S
    x, y, z = (rate / math.hypot(*rates) for rate in rates)
    c, s, v = math.cos(angle), math.sin(angle), 1 - math.cos(angle)
    step = (
        (c + x * x * v, x * y * v - z * s, x * z * v + y * s),
        (y * x * v + z * s, c + y * y * v, y * z * v - x * s),
        (z * x * v - y * s, z * y * v + x * s, c + z * z * v),
    )
    return [tuple(sum(row[k] * step[k][j] for k in range(3)) for j in range(3)) for row in matrix]  # type: ignore[misc]


def test_body_rates_integrate_to_the_attitude() -> None:
    vessel = boat(Leg(10.0, 40.0), Leg(20.0, turn_dps=-8.0), Leg(30.0, 300.0), waters=Waters(sea=ROUGH))
    motion = vessel.motion
    matrix = attitude_matrix(motion)
    rates = motion.body_rates()
    for _ in range(6000):
        vessel.advance()
        after = motion.body_rates()
        matrix = turned(matrix, tuple(0.5 * (a + b) for a, b in zip(rates, after, strict=True)))  # type: ignore[arg-type]
        rates = after
    heading = math.atan2(matrix[1][0], matrix[0][0])
    assert math.degrees(math.remainder(heading - motion.heading_rad, math.tau)) == pytest.approx(0.0, abs=0.02)
    assert math.degrees(math.atan2(matrix[2][1], matrix[2][2]) - motion.roll_rad) == pytest.approx(0.0, abs=0.02)
    assert math.degrees(-math.asin(matrix[2][0]) - motion.pitch_rad) == pytest.approx(0.0, abs=0.02)


def test_gyro_roll_and_pitch_give_the_rate_of_turn() -> None:
    vessel = boat(circle(7.0), waters=Waters(sea=ROUGH))
    for _ in range(1000):
        vessel.advance()
        motion = vessel.motion
        _, gy, gz = motion.body_rates()
        rate = (gy * math.sin(motion.roll_rad) + gz * math.cos(motion.roll_rad)) / math.cos(motion.pitch_rad)
        assert rate == pytest.approx(motion.yaw_rate, abs=1e-12)


def test_heading_changes_by_the_rate_of_turn() -> None:
    rows = sail(boat(circle(7.0), waters=Waters(sea=ROUGH)), 20.0)
    for before, now, after in zip(rows, rows[1:], rows[2:], strict=False):
        assert (after[0] - before[0]) / (2 * STEP_S) == pytest.approx(now[5], abs=1e-3)


def test_gravity_at_rest_gives_roll_and_pitch() -> None:
    motion = Motion()
    assert motion.body_gravity() == pytest.approx((0.0, 0.0, 1.0))
    motion.roll_rad, motion.pitch_rad, motion.heading_rad = 0.3, -0.2, 2.0
    x, y, z = motion.body_gravity()
    assert math.atan2(y, z) == pytest.approx(0.3)
    assert math.atan2(-x, math.hypot(y, z)) == pytest.approx(-0.2)


def test_turn_fakes_a_heel_to_port_when_turning_to_starboard() -> None:
    vessel = boat(Leg(60.0, turn_dps=10.0))
    sail(vessel, 20.0)
    _, y, z = vessel.motion.body_gravity()
    faked_deg = math.degrees(math.atan2(y, z) - vessel.motion.roll_rad)
    assert faked_deg == pytest.approx(-math.degrees(math.atan(5.0 * math.radians(10.0) / 9.80665)), abs=0.05)


@pytest.mark.parametrize(("turn_dps", "side"), [(10.0, -1.0), (-10.0, 1.0)])
def test_bow_points_into_the_turn_and_the_boat_slides_outwards(turn_dps: float, side: float) -> None:
    row = sail(boat(Leg(60.0, turn_dps=turn_dps)), 20.0)[-1]
    assert 2.0 < side * drift_angle_deg(row) < 6.0


def test_without_turn_wind_and_current_the_course_is_the_heading() -> None:
    assert drift_angle_deg(sail(boat(Leg(60.0, 123.0), heading_deg=123.0), 10.0)[-1]) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("wind_from_deg", "leeway_deg"), [(90.0, -0.5), (270.0, 0.5), (0.0, 0.0), (180.0, 0.0)])
def test_wind_presses_the_boat_to_lee(wind_from_deg: float, leeway_deg: float) -> None:
    waters = Waters(wind_from_deg=wind_from_deg, leeway_deg=0.5)
    assert drift_angle_deg(sail(boat(Leg(60.0, 0.0), waters=waters), 1.0)[-1]) == pytest.approx(leeway_deg, abs=1e-6)


def test_current_moves_the_course_towards_its_set() -> None:
    waters = Waters(set_deg=90.0, drift_mps=0.45, leeway_deg=0.0)
    row = sail(boat(Leg(60.0, 0.0), waters=waters, speed_mps=3.0), 1.0)[-1]
    assert drift_angle_deg(row) == pytest.approx(math.degrees(math.atan(0.45 / 3.0)))


def test_a_full_circle_draws_the_current_as_the_mean_velocity() -> None:
    waters = Waters(set_deg=30.0, drift_mps=0.5, leeway_deg=0.0)
    vessel = boat(Leg(300.0, turn_dps=6.0), waters=waters)
    sail(vessel, 20.0)  # until the turn is steady
    rows = sail(vessel, 60.0)
    assert statistics.fmean(row[3] for row in rows) == pytest.approx(0.5 * math.cos(math.radians(30.0)), abs=1e-3)
    assert statistics.fmean(row[4] for row in rows) == pytest.approx(0.5 * math.sin(math.radians(30.0)), abs=1e-3)


def test_helm_reaches_the_heading_the_shorter_way_within_the_rate_limit() -> None:
    rows = sail(boat(Leg(60.0, 350.0, max_turn_dps=5.0), heading_deg=20.0), 40.0)
    assert math.degrees(rows[-1][0]) == pytest.approx(-10.0, abs=0.05)
    assert max(abs(row[5]) for row in rows) <= math.radians(5.0) + 1e-9
    assert min(row[0] for row in rows) > math.radians(-10.5)


def test_plan_repeats_without_its_prefix() -> None:
    helm = Helm(
        (Leg(10.0, turn_dps=1.0), Leg(10.0, turn_dps=2.0)), 3.0, prefix=(Leg(5.0, turn_dps=9.0, speed_mps=4.0),)
    )
    rates = [round(math.degrees(helm.turn_rate(t_s, 0.0))) for t_s in (0.0, 4.9, 5.0, 15.0, 25.0, 35.0, 45.0)]
    assert rates == [9, 9, 1, 2, 1, 2, 1]
    assert helm.speed_mps == 4.0


def test_zigzag_stays_about_north() -> None:
    assert [leg.heading_deg for leg in zigzag(0.0, 2.0, 20.0)] == [2.0, 358.0]


def test_a_leg_without_length_is_refused() -> None:
    with pytest.raises(ValueError, match="0 s"):
        Leg(0.0, 10.0)


def test_dock_stays_where_it_is() -> None:
    scenario = SCENARIOS["dock"]
    vessel = Vessel(
        scenario.plan, scenario.waters, heading_deg=scenario.heading_deg, speed_mps=scenario.speed_mps, seed=1
    )
    rows = sail(vessel, 120.0)
    assert max(abs(row[1] - scenario.waters.lat_deg) for row in rows) * 111_000 < 0.5
    assert all(math.degrees(row[0]) == pytest.approx(72.0, abs=3.0) for row in rows)


@pytest.mark.parametrize("name", SCENARIOS)
def test_settled_voyage_begins_with_a_full_circle_and_returns_to_its_heading(name: str) -> None:
    scenario = settled(scenario_named(name))
    vessel = Vessel(
        scenario.plan,
        scenario.waters,
        heading_deg=scenario.heading_deg,
        speed_mps=scenario.speed_mps,
        prefix=scenario.prefix,
    )
    rows = sail(vessel, sum(leg.duration_s for leg in scenario.prefix))
    assert rows[-1][0] - rows[0][0] == pytest.approx(math.tau, abs=math.radians(4.0))
    shifted = [
        after.start_s - before.start_s for after, before in zip(scenario.faults, SCENARIOS[name].faults, strict=True)
    ]
    assert all(shift == pytest.approx(len(rows) * STEP_S, abs=0.01) for shift in shifted)


def test_harbour_goes_from_walking_pace_to_four_metres_a_second() -> None:
    scenario = SCENARIOS["harbour"]
    vessel = Vessel(scenario.plan, Waters(), heading_deg=scenario.heading_deg, speed_mps=scenario.speed_mps, seed=1)
    speeds = [math.hypot(row[3], row[4]) for row in sail(vessel, 400.0)]
    assert min(speeds) == pytest.approx(0.4, abs=0.1)
    assert max(speeds) == pytest.approx(4.0, abs=0.1)

"""Simulated devices on real trajectories."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from acquisition.simulator.trajectory import Trajectory, TrajectoryError
from acquisition.simulator.vessel import metres_per_degree

HEADER = "GPSTime,easting,northing,roll,pitch,heading"
RADIUS_M, OMEGA = 40.0, 0.1  # a circle to starboard at 4 m/s


def circle_file(path: Path, seconds: float = 70.0) -> Path:
    rows = [HEADER]
    for i in range(round(seconds * 10)):
        t = i / 10
        x, y = RADIUS_M * (1.0 - math.cos(OMEGA * t)), RADIUS_M * math.sin(OMEGA * t)
        rows.append(f"{round(t * 1e6)},{500000.0 + x!r},{4848821.0 + y!r},0.0,0.01,{OMEGA * t - 0.2!r}")
    path.write_text("\n".join(rows) + "\n")
    return path


def test_the_boat_points_where_she_goes_on_a_circle(tmp_path: Path) -> None:
    """On the central meridian UTM's north is true north: the course is known in closed form."""
    trajectory = Trajectory(circle_file(tmp_path / "circle.csv"), heading_offset_deg=math.degrees(0.2))
    start = trajectory.motion.lat_deg, trajectory.motion.lon_deg
    lat_m, lon_m = metres_per_degree(start[0])
    for _ in range(6000):
        trajectory.advance()
        motion = trajectory.motion
        angle = OMEGA * motion.t_s
        assert motion.heading_rad == pytest.approx(angle, abs=1e-5)
        if motion.t_s > 0.2:
            assert motion.yaw_rate == pytest.approx(OMEGA, abs=1e-5)
            assert math.hypot(motion.north_mps, motion.east_mps) == pytest.approx(RADIUS_M * OMEGA / 0.9996, rel=1e-3)
            assert motion.accel_north == pytest.approx(-RADIUS_M * OMEGA**2 * math.sin(angle), abs=0.02)
    assert start[1] == pytest.approx(-81.0)
    assert start[0] == pytest.approx(43.79, abs=0.02)
    assert (motion.lat_deg - start[0]) * lat_m == pytest.approx(RADIUS_M * math.sin(angle), abs=0.05)
    assert (motion.lon_deg - start[1]) * lon_m == pytest.approx(RADIUS_M * (1.0 - math.cos(angle)), abs=0.05)


def test_it_stays_at_its_end(tmp_path: Path) -> None:
    trajectory = Trajectory(circle_file(tmp_path / "circle.csv", seconds=2.0))
    for _ in range(400):
        trajectory.advance()
    assert (trajectory.motion.north_mps, trajectory.motion.yaw_rate) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a,b\n1,2\n", "columns"),
        (f"{HEADER}\n0,1,1,0,0,0\n0,1,1,0,0,0\n", "rise"),
        (f"{HEADER}\n0,x,1,0,0,0\n", "columns"),
    ],
)
def test_a_bad_file_is_named(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "poses.csv"
    path.write_text(text)
    with pytest.raises(TrajectoryError, match=said):
        Trajectory(path)


def test_boreas_goes_where_it_points(recordings: Path) -> None:
    trajectory = Trajectory(next((recordings / "boreas").glob("*.csv")))
    errors = []
    for _ in range(30_000):
        trajectory.advance()
        motion = trajectory.motion
        if math.hypot(motion.north_mps, motion.east_mps) > 5.0:
            course = math.atan2(motion.east_mps, motion.north_mps)
            errors.append(math.degrees(math.remainder(course - motion.heading_rad, math.tau)))
    assert abs(sum(errors) / len(errors)) < 0.15
    assert max(map(abs, errors)) < 8.0

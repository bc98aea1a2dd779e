"""A trajectory that once was sailed or driven, as the mover of simulated devices: real motion, simulated errors.

The file is a CSV of poses such as the Boreas dataset's (`GPSTime` in microseconds, UTM `easting`, `northing` in metres,
`roll`, `pitch`, `heading` in radians), some ten a second. Between poses position and attitude follow cubic splines
through the measured points (Catmull-Rom), so that velocity and rates are continuous, as a gyro and a receiver need.
"""

from __future__ import annotations

import csv
import itertools
import math
from pathlib import Path

from acquisition.simulator.vessel import STEP_S, Motion, metres_per_degree

#: Boreas' headings plus this are true headings.
BOREAS_HEADING_OFFSET_DEG = 44.3
UTM_ZONE = 17

_UTM_SCALE = 0.9996
_COLUMNS = ("GPSTime", "easting", "northing", "roll", "pitch", "heading")
_MAX_GAP_S = 2.0


class TrajectoryError(ValueError):
    """A file of poses that cannot be followed: one line saying which and why."""


class Trajectory:
    """Follows the poses of a file; a `voyage.Mover`. At its end it stays where it is.

    `heading_offset_deg` turns the file's headings into true ones; `zone` is the UTM zone of its positions (north).
    """

    def __init__(
        self, path: str | Path, *, heading_offset_deg: float = BOREAS_HEADING_OFFSET_DEG, zone: int = UTM_ZONE
    ) -> None:
        times, poses = _read(Path(path))
        self._times = times
        lat, lon, convergence = _geodetic_of_utm(poses[0][0], poses[0][1], zone)
        self._turn = convergence
        self._values = _unwrapped(poses, math.radians(heading_offset_deg))
        self._slopes = _slopes(times, self._values)
        self._index = 0
        self._origin = (lat, lon)
        self._m_per_deg = metres_per_degree(lat)
        self.duration_s = times[-1]
        self.motion = Motion()
        self._place()
        self.motion.accel_north = self.motion.accel_east = 0.0

    def advance(self) -> None:
        """Go on by one step of 10 ms."""
        self.motion.step += 1
        north_mps, east_mps = self.motion.north_mps, self.motion.east_mps
        self._place()
        self.motion.accel_north = (self.motion.north_mps - north_mps) / STEP_S
        self.motion.accel_east = (self.motion.east_mps - east_mps) / STEP_S

    def _place(self) -> None:
        motion = self.motion
        t_s = min(motion.t_s, self._times[-1])
        while self._index < len(self._times) - 2 and t_s >= self._times[self._index + 1]:
            self._index += 1
        i = self._index
        length = self._times[i + 1] - self._times[i]
        s = (t_s - self._times[i]) / length
        places = [
            _hermite(s, length, *ends)
            for ends in zip(self._values[i], self._slopes[i], self._values[i + 1], self._slopes[i + 1], strict=True)
        ]
        if motion.t_s >= self._times[-1]:
            places = [(value, 0.0) for value, _ in places]
        (x, x_rate), (y, y_rate), (roll, roll_rate), (pitch, pitch_rate), (heading, heading_rate) = places
        # UTM's north is off true north by the convergence, and its metre by the scale of the projection.
        sin, cos = math.sin(self._turn) / _UTM_SCALE, math.cos(self._turn) / _UTM_SCALE
        lat_m, lon_m = self._m_per_deg
        motion.lat_deg = self._origin[0] + (y * cos - x * sin) / lat_m
        motion.lon_deg = self._origin[1] + (x * cos + y * sin) / lon_m
        motion.north_mps, motion.east_mps = y_rate * cos - x_rate * sin, x_rate * cos + y_rate * sin
        motion.heading_rad, motion.yaw_rate = heading, heading_rate
        motion.roll_rad, motion.roll_rate = roll, roll_rate
        motion.pitch_rad, motion.pitch_rate = pitch, pitch_rate


Pose = tuple[float, float, float, float, float]  # easting, northing (m), roll, pitch, heading (rad)


def _read(path: Path) -> tuple[list[float], list[Pose]]:
    """Seconds since the first pose, and the poses."""
    times: list[float] = []
    poses: list[Pose] = []
    try:
        with path.open(newline="", encoding="ascii") as file:
            for row in csv.DictReader(file):
                t_us, *values = (float(row[column]) for column in _COLUMNS)
                times.append(t_us / 1e6)
                poses.append((values[0], values[1], values[2], values[3], values[4]))
    except OSError as error:
        raise TrajectoryError(f"cannot read trajectory {path}: {error.strerror or error}") from error
    except (KeyError, TypeError, ValueError) as error:
        raise TrajectoryError(f"{path} has not the columns of poses ({', '.join(_COLUMNS)}): {error}") from error
    gaps = [after - before for before, after in itertools.pairwise(times)]
    if len(times) < 2 or not all(0.0 < gap <= _MAX_GAP_S for gap in gaps):
        raise TrajectoryError(f"{path}: its times do not rise by at most {_MAX_GAP_S:g} s from pose to pose")
    return [t_s - times[0] for t_s in times], poses


def _unwrapped(poses: list[Pose], heading_offset: float) -> list[Pose]:
    """Positions from the first one, headings made true and going on over a full circle."""
    east, north = poses[0][:2]
    heading = poses[0][4] + heading_offset
    result = []
    for x, y, roll, pitch, said in poses:
        heading += math.remainder(said + heading_offset - heading, math.tau)
        result.append((x - east, y - north, roll, pitch, heading))
    return result


def _slopes(times: list[float], values: list[Pose]) -> list[Pose]:
    """Rate of each value at each pose, from its neighbours."""
    last = len(times) - 1
    slopes = []
    for i in range(len(times)):
        before, after = max(i - 1, 0), min(i + 1, last)
        span = times[after] - times[before]
        a, b, c, d, e = ((v1 - v0) / span for v0, v1 in zip(values[before], values[after], strict=True))
        slopes.append((a, b, c, d, e))
    return slopes


def _hermite(s: float, length: float, v0: float, m0: float, v1: float, m1: float) -> tuple[float, float]:
    """Value and rate at the share `s` of an interval, from the values and rates at its ends."""
    rise = (v1 - v0) / length
    c2 = 3.0 * rise - 2.0 * m0 - m1
    c3 = m0 + m1 - 2.0 * rise
    return v0 + s * length * (m0 + s * (c2 + s * c3)), m0 + s * (2.0 * c2 + 3.0 * s * c3)


def _geodetic_of_utm(easting_m: float, northing_m: float, zone: int) -> tuple[float, float, float]:
    """Latitude and longitude (degrees) and convergence (rad; grid north east of true north is positive) of a point.

    By iteration on the sphere-like series to the second order: good to some metres, and to a thousandth of a degree of
    convergence, which is all that a local plane needs.
    """
    lat = northing_m / _UTM_SCALE / 111_132.95
    for _ in range(8):
        radians = math.radians(lat)
        arc = (
            111_132.952 * lat
            - 16_038.509 * math.sin(2.0 * radians)
            + 16.833 * math.sin(4.0 * radians)
            - 0.022 * math.sin(6.0 * radians)
        )
        lat += (northing_m / _UTM_SCALE - arc) / 111_132.95
    aside = (easting_m - 500_000.0) / _UTM_SCALE
    lat_m, lon_m = metres_per_degree(lat)
    radians = math.radians(lat)
    lon_offset = aside / lon_m
    lat -= 0.5 * math.radians(lon_offset) * aside * math.sin(radians) / lat_m
    convergence = math.atan(math.tan(math.radians(lon_offset)) * math.sin(radians))
    return lat, zone * 6.0 - 183.0 + lon_offset, convergence

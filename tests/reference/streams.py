"""The reference streams: short sequences of samples and task switches, each bent to reach some corner of the fusion.

`STREAMS` names them; `Stream.items()` makes one. What a stream is for stands in its function's first line.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from boat import NAN, Boat, Item, TaskSwitch, between, sail, turn, without
from sticking_streams import sticking, sticking_unseen

from acquisition.sample import COMPASS, IMU, REFERENCE_TRUE, CompassSample, GpsSample, ImuSample, Sample

ALL_METHODS = ("cnw-ekf", "cnw3", "ekf-ci")
THREE_FILTERS = ("cnw3", "ekf-ci")  # the heading of cnw-ekf is their first filter's


@dataclass(frozen=True, slots=True)
class Options:
    """What shapes the fusion of a stream; mount as (roll, pitch, yaw) in degrees."""

    n_gps: int = 3
    absent: tuple[str, ...] = ()  #: sources left out of the configuration
    variation_deg: float = 0.0  #: NaN: from the sentences
    deviation: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    mount_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    specific_force: bool = False
    max_sigma_deg: float = 30.0


@dataclass(frozen=True, slots=True)
class Stream:
    """A named sequence, its options and the methods that are run over it."""

    name: str
    items: Callable[[], list[Item]]
    options: Options = Options()
    methods: tuple[str, ...] = THREE_FILTERS


def _with_tasks(samples: Iterable[Sample], switches: Iterable[tuple[float, str, str]]) -> list[Item]:
    """Samples with task switches (seconds, name, verb) merged in by time."""
    tasks = [TaskSwitch(round(t_s * 1e6), name, verb == "start") for t_s, name, verb in switches]
    return sorted([*samples, *tasks], key=lambda item: item.t_us)


def straight_north() -> list[Item]:
    """All sensors on a course that swings about north, where arithmetic means break."""
    return list(sail(Boat(101, rate_dps=lambda t_s: 2.0 * math.cos(2.0 * t_s))))


def dateline() -> list[Item]:
    """A steady turn over the date line, east to west and back."""
    return list(sail(Boat(102, lat_deg=-17.5, lon_deg=179.9999, heading_deg=60.0, rate_dps=turn(12.0))))


def far_south() -> list[Item]:
    """1 Hz GPS at 62 degrees south: filters fed by the compass between the epochs."""
    return list(sail(Boat(103, lat_deg=-62.2, lon_deg=-58.9, heading_deg=200.0, gps_period_us=1_000_000)))


def late_start() -> list[Item]:
    """The first stamp lies off the grid; the last samples on it."""
    samples: list[Item] = list(sail(Boat(104, duration_s=8.0, start_us=7_345_678)))
    return [
        *samples,
        ImuSample(16_000_000, IMU, gyro_x_dps=0.0, gyro_y_dps=0.0, gyro_z_dps=5.0),
        CompassSample(16_100_000, COMPASS, heading_deg=11.0),
        CompassSample(16_200_000, COMPASS, heading_deg=12.0),
    ]


def no_compass() -> list[Item]:
    """No compass at all: silent filters are steered by the other receivers."""
    samples = sail(Boat(105, compass=False, heading_deg=275.0))
    return list(without(samples, lambda s: s.source == 1 and between(6, 16, s)))


def no_imu() -> list[Item]:
    """No IMU at all: the prediction runs at the updates, straight on."""
    return list(sail(Boat(106, imu=False, rate_dps=turn(-8.0))))


def no_gps() -> list[Item]:
    """Compass and IMU only, and the compass goes after 15 s."""
    samples = sail(Boat(107, gps=(), rate_dps=turn(5.0)))
    return list(without(samples, lambda s: s.source == COMPASS and between(15, 25, s)))


def gps_alone() -> list[Item]:
    """One receiver and nothing else, with a gap."""
    samples = sail(Boat(108, gps=(0,), compass=False, imu=False, heading_deg=90.0))
    return list(without(samples, lambda s: between(10, 14.5, s)))


def imu_alone() -> list[Item]:
    """Nothing that could start a heading."""
    return list(sail(Boat(109, duration_s=5.0, gps=(), compass=False)))


def blackouts() -> list[Item]:
    """All GPS vanish for 13 s (positions are anchored after), then everything but the IMU for 4 s."""
    samples = sail(Boat(110, duration_s=45.0, heading_deg=350.0))
    samples = without(samples, lambda s: s.source < 3 and between(8, 21, s))
    samples = without(samples, lambda s: s.source != IMU and between(30, 34, s))
    return list(without(samples, lambda s: between(38, 41, s)))


def no_fix() -> list[Item]:
    """Receivers that keep talking without a fix, one after the other and all at once; some lose only the speed."""

    def bent(s: Sample) -> Sample:
        if not isinstance(s, GpsSample):
            return s
        if between(5 + 4 * s.source, 12 + 4 * s.source, s):
            return s._replace(fix_quality=0, lat_deg=NAN, lon_deg=NAN, speed_mps=NAN, hdop=99.9)
        if between(26, 30, s):
            return s._replace(fix_quality=0)
        if between(31, 35, s):
            return s._replace(speed_mps=NAN)
        return s

    return [bent(s) for s in sail(Boat(111, duration_s=40.0, heading_deg=130.0))]


def silence() -> list[Item]:
    """70 s without a word, longer than the position may be reckoned."""
    samples = sail(Boat(112, duration_s=80.0, rate_dps=turn(1.0), gps=(0, 1)))
    return list(without(samples, lambda s: between(4, 74, s)))


def long_reckoning() -> list[Item]:
    """62 s without a position while compass and a slow IMU go on."""
    samples = sail(Boat(113, duration_s=70.0, rate_dps=turn(2.0)))
    samples = without(samples, lambda s: s.source < 3 and between(3, 66, s))
    return list(without(samples, lambda s: s.source == IMU and s.t_us % 200_000 != 0))


def bursts() -> list[Item]:
    """IMU samples that come several to a stamp, with other sensors between and gaps of more than 1 s."""
    chance = random.Random(114)
    items: list[Item] = []
    held: list[ImuSample] = []
    size = 3
    for s in sail(Boat(114, rate_dps=lambda t_s: 20.0 * math.sin(3.0 * t_s))):
        if not isinstance(s, ImuSample):
            items.append(s)
            continue
        if between(12, 14, s):
            continue
        held.append(s)
        if len(held) >= size:
            items.extend(one._replace(t_us=s.t_us) for one in held)
            held, size = [], chance.choice((1, 2, 3, 5, 9))
    return items


def interleaved() -> list[Item]:
    """Arrival and stamps disagree: late samples are taken at the latest stamp, very late ones refused."""
    chance = random.Random(115)
    items: list[Item] = []
    for s in sail(Boat(115, heading_deg=180.0)):
        draw = chance.random()
        late_us = 1_000_000 if draw < 0.002 else 1_000_001 if draw < 0.004 else chance.randrange(25_000)
        items.append(s._replace(t_us=max(0, s.t_us - late_us)) if draw < 0.4 else s)
    return items


def compass_sources() -> list[Item]:
    """Variation from the sentence, then from a GPS, then true headings; deviation from sentence and table."""

    def bent(s: Sample) -> Sample:
        if isinstance(s, CompassSample):
            if between(6, 12, s):
                return s._replace(variation_deg=-8.5, deviation_deg=2.5)
            if between(12, 16, s):
                return s._replace(variation_deg=-7.5)
            if between(20, 24, s):
                return s._replace(reference=REFERENCE_TRUE)
            if between(24, 25, s):
                return s._replace(heading_deg=NAN)
            if between(25, 28, s):
                return s._replace(deviation_deg=-3.0)
        if isinstance(s, GpsSample) and s.source == 1 and between(9, 14, s):
            return s._replace(variation_deg=-8.0)
        return s

    return [bent(s) for s in sail(Boat(116, compass_error_deg=8.0, heading_deg=30.0, rate_dps=turn(10.0)))]


def tilted() -> list[Item]:
    """Heavy rolling in a turn; used with a deviation table, a mount and a specific-force accelerometer."""
    boat = Boat(117, roll_deg=lambda t_s: 25.0 * math.sin(1.1 * t_s), pitch_deg=-6.0, rate_dps=turn(9.0))
    return list(sail(boat))


def hurt_imu() -> list[Item]:
    """An IMU with holes: no accelerometer at first, NaN gyros, free fall, capsizing, long gaps."""

    def bent(s: Sample) -> Sample:
        if not isinstance(s, ImuSample):
            return s
        if s.t_us < 2_000_000:
            return s._replace(accel_x_g=NAN, accel_y_g=NAN, accel_z_g=NAN)
        if s.t_us < 3_000_000:
            return s._replace(accel_x_g=0.05, accel_y_g=0.02, accel_z_g=0.01)
        if between(6, 6.5, s):
            return s._replace(gyro_z_dps=NAN)
        if between(7, 7.5, s):
            return s._replace(gyro_x_dps=NAN, accel_x_g=0.7)
        if between(9, 11, s):
            return s._replace(accel_z_g=NAN)
        if between(13, 15, s):
            return s._replace(accel_x_g=-1.0, accel_y_g=0.001, accel_z_g=0.002, gyro_y_dps=60.0)
        if between(20, 22, s):
            return s._replace(accel_x_g=0.1, accel_y_g=0.2, accel_z_g=-0.9, gyro_x_dps=170.0)
        if between(26.5, 27, s):
            return s._replace(accel_x_g=NAN)
        return s

    samples = sail(Boat(118, rate_dps=turn(-4.0)))
    samples = without(samples, lambda s: s.source == IMU and (between(17, 18.5, s) or between(25, 26.5, s)))
    return [bent(s) for s in samples]


def task_switches() -> list[Item]:
    """Every task stopped and started once, some together."""
    names = ("gps1", "gps2", "gps3", "compass", "imu", "cnw-s1", "cnw-s2", "ekf1", "ekf2", "ekf3", "cnw-s3")
    switches = [(2.05 + 3.0 * k, name, "stop") for k, name in enumerate(names)]
    switches += [(4.05 + 3.0 * k, name, "start") for k, name in enumerate(names)]
    switches += [(36.0, "ekf1", "stop"), (36.0, "cnw-s3", "stop"), (38.0, "ekf1", "start"), (39.0, "cnw-s3", "start")]
    switches += [(40.0, name, "stop") for name in names[:5]] + [(40.4, "gps2", "start"), (43.0, "imu", "start")]
    switches += [(44.0, name, "start") for name in names[:4]]
    switches += [(46.0, "cnw-s2", "stop"), (46.5, "gps1", "stop"), (48.0, "cnw-s2", "start"), (48.5, "gps1", "start")]
    return _with_tasks(sail(Boat(119, duration_s=50.0, heading_deg=310.0)), switches)


def origin_move() -> list[Item]:
    """Positions jump 8 km, then 40 km, at different moments for each receiver; one filter is off meanwhile."""

    def bent(s: Sample) -> Sample:
        if not isinstance(s, GpsSample):
            return s
        north = 0.07 if s.t_us > (8.0 + 0.5 * s.source) * 1e6 else 0.0
        east = 0.45 if s.t_us > (16.0 + 0.5 * s.source) * 1e6 else 0.0
        return s._replace(lat_deg=round(s.lat_deg + north, 9), lon_deg=round(s.lon_deg + east, 9))

    samples = [bent(s) for s in sail(Boat(120, heading_deg=45.0))]
    return _with_tasks(samples, [(14.0, "ekf2", "stop"), (20.0, "ekf2", "start")])


def qualities() -> list[Item]:
    """Every fix quality and HDOP class, borders and nonsense among them; at last no weight at all."""
    chance = random.Random(121)
    hdops = (0.5, 1.0, 2.0, 2.001, 5.0, 5.01, 10.0, 10.5, 21.0, 0.0, -1.0, NAN)

    def bent(s: Sample) -> Sample:
        if isinstance(s, GpsSample):
            if s.t_us > 24_000_000:
                return s._replace(fix_quality=6, hdop=1.0)
            return s._replace(fix_quality=chance.choice((-1, 0, 1, 2, 3, 4, 5, 6, 7, 8)), hdop=chance.choice(hdops))
        return s

    samples = [bent(s) for s in sail(Boat(121, heading_deg=5.0, rate_dps=turn(-3.0)))]
    return list(
        without(
            samples,
            lambda s: (s.source == COMPASS and between(20, 23, s)) or (s.t_us > 27_000_000 and s.source == COMPASS),
        )
    )


def at_rest() -> list[Item]:
    """Moored: positions repeat to the digit, so that there is no forward azimuth for long."""

    def bent(s: Sample) -> Sample:
        if isinstance(s, GpsSample) and s.t_us > 5_000_000:
            return s._replace(lat_deg=round(s.lat_deg, 6), lon_deg=round(s.lon_deg, 6), speed_mps=0.0)
        return s

    return [bent(s) for s in sail(Boat(122, duration_s=20.0, speed_mps=0.1, rate_dps=turn(0.2)))]


def pairs() -> list[Item]:
    """1 Hz receivers whose epochs come two or three to a read, or one late and the next early."""
    items: list[Item] = []
    for s in sail(Boat(126, gps_period_us=1_000_000, compass=False)):
        second = s.t_us // 1_000_000
        late_s = 0
        if isinstance(s, GpsSample):
            late_s = (1 if second % 4 == 1 else 0, 2 - second % 3, 0)[s.source]
        late_us = late_s * 1_000_000 - (40_000 if s.source == 0 and late_s else 0)
        items.append(s._replace(t_us=s.t_us + late_us))
    return sorted(items, key=lambda item: item.t_us)


def opposed() -> list[Item]:
    """Two receivers sail exactly opposite ways on the equator with equal weights: the mean cancels."""
    items: list[Item] = []
    for k in range(100):
        t_us = k * 100_000
        way = 1e-5 * k
        quality = 2 if k < 60 else 7
        for i, lon in enumerate((way, -way)):
            items.append(
                GpsSample(t_us + 10_000 * i, i, fix_quality=quality, lat_deg=0.0, lon_deg=lon, speed_mps=5.0, hdop=1.0)
            )
        if 40 <= k < 50:
            items.append(CompassSample(t_us + 50_000, COMPASS, reference=REFERENCE_TRUE, heading_deg=10.0))
    return items


STREAMS: tuple[Stream, ...] = (
    Stream("straight_north", straight_north, methods=ALL_METHODS),
    Stream("dateline", dateline, methods=("cnw3",)),
    Stream("far_south", far_south, Options(variation_deg=12.5), methods=("cnw3",)),
    Stream("late_start", late_start, methods=("cnw3",)),
    Stream("no_compass", no_compass, Options(absent=("compass",)), methods=("cnw3",)),
    Stream("no_imu", no_imu, Options(absent=("imu",))),
    Stream("no_gps", no_gps),
    Stream("gps_alone", gps_alone, Options(n_gps=1, absent=("compass", "imu")), methods=ALL_METHODS),
    Stream("imu_alone", imu_alone, methods=("cnw3",)),
    Stream("blackouts", blackouts, methods=ALL_METHODS),
    Stream("no_fix", no_fix),
    Stream("silence", silence, Options(n_gps=2), methods=("cnw3",)),
    Stream("long_reckoning", long_reckoning, methods=("cnw3",)),
    Stream("bursts", bursts),
    Stream("interleaved", interleaved),
    Stream(
        "compass_sources",
        compass_sources,
        Options(variation_deg=NAN, deviation=(1.0, -2.0, 0.5, 0.8, -0.3)),
        methods=("cnw3",),
    ),
    Stream(
        "tilted",
        tilted,
        Options(
            variation_deg=-8.0, deviation=(0.5, 3.0, -1.0, 0.4, 0.2), mount_deg=(10.0, -20.0, 35.0), specific_force=True
        ),
        methods=("cnw3",),
    ),
    Stream("hurt_imu", hurt_imu, methods=("cnw3", "ekf-ci")),
    Stream("task_switches", task_switches, methods=ALL_METHODS),
    Stream("origin_move", origin_move),
    Stream("qualities", qualities),
    Stream("at_rest", at_rest, methods=("cnw3",)),
    Stream("sticking", sticking, methods=ALL_METHODS),
    Stream("sticking_unseen", sticking_unseen, methods=ALL_METHODS),
    Stream("pairs", pairs, methods=("cnw3",)),
    Stream("opposed", opposed, Options(n_gps=2), methods=("cnw3", "cnw-ekf")),
    Stream(
        "five_gps",
        lambda: list(sail(Boat(123, duration_s=15.0, gps=(0, 1, 2, 3, 4)))),
        Options(n_gps=5),
        methods=("cnw3", "ekf-ci"),
    ),
    Stream(
        "small_max_sigma",
        lambda: list(sail(Boat(124, duration_s=12.0, gps_period_us=500_000, compass=False))),
        Options(max_sigma_deg=1.2),
    ),
)

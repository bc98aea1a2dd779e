"""What a user of the fusion counts on: a heading while one source can carry it, and a mode that tells the truth."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Iterator

import pytest

from acquisition.sample import COMPASS, IMU, CompassSample, GpsSample, ImuSample, Sample
from tinyekf_py import Estimate, HeadingFusion

METHODS = ("cnw-ekf", "cnw3", "ekf-ci")
SPEED_MPS = 5.0


def boat(
    seconds: float,
    *,
    heading_deg: float = 0.0,
    swing_deg: float = 0.0,
    gps: tuple[int, ...] = (0, 1, 2),
    compass: bool = True,
    imu: bool = True,
    start_s: float = 0.0,
    hdop: float = 1.0,
    fix: int = 2,
) -> Iterator[Sample]:
    """Ideal sensors of a boat that swings about a heading with a period of 20 s."""
    north = east = 0.0
    for tick in range(int(start_s * 100), int((start_s + seconds) * 100)):
        t = tick / 100
        phase = 2 * math.pi * t / 20
        heading = heading_deg + swing_deg * math.sin(phase)
        rate = swing_deg * 2 * math.pi / 20 * math.cos(phase)
        north += SPEED_MPS / 100 * math.cos(math.radians(heading))
        east += SPEED_MPS / 100 * math.sin(math.radians(heading))
        t_us = tick * 10_000 + 3000
        if imu:
            noise = 1e-3 * (t_us // 10_000 % 2)  # one that repeats itself is taken for stuck
            yield ImuSample(t_us, IMU, 0, 0, 0, 0, 0, 0, rate, 0, 0, 1 + noise)
        if tick % 10 == 5:
            for i in gps:
                lat, lon = 36 + north / 110_950, 126 + east / 90_000
                yield GpsSample(t_us + 1000 + i, i, fix, 1.79e9 + t, lat, lon, 0, SPEED_MPS, heading % 360, hdop)
        if compass and tick % 10 == 8:
            yield CompassSample(t_us + 2000, COMPASS, 1, heading % 360)


def rows_of(fusion: HeadingFusion, samples: Iterator[Sample]) -> list[Estimate]:
    return fusion.feed_records(b"".join(sample.pack() for sample in samples))


def off(a: float, b: float) -> float:
    return math.remainder(a - b, 360.0)


@pytest.mark.parametrize("method", METHODS)
def test_heading_stays_continuous_across_north(method: str) -> None:
    rows = rows_of(HeadingFusion(method), boat(60, swing_deg=2.0))[20:]
    errors = [off(row.heading_deg, 2.0 * math.sin(2 * math.pi * row.t_us / 20e6)) for row in rows]
    assert {row.mode for row in rows} == {"ok"}
    assert abs(sum(errors) / len(errors)) < 0.1
    assert max(map(abs, errors)) < 1.0


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "aboard",
    [
        {"gps": (), "imu": False},
        {"gps": (), "imu": True},
        {"compass": False, "imu": False},
        {"compass": False, "gps": (1,)},
        {"gps": (2,)},
        {"imu": False},
    ],
    ids=str,
)
def test_one_source_carries_the_heading(method: str, aboard: dict[str, object]) -> None:
    rows = rows_of(HeadingFusion(method), boat(30, heading_deg=40.0, **aboard))[10:]  # type: ignore[arg-type]
    assert {row.mode for row in rows} == {"degraded"}
    assert max(abs(off(row.heading_deg, 40.0)) for row in rows) < 1.0


@pytest.mark.parametrize("method", METHODS)
def test_gyro_alone_is_dead_reckoning_until_it_knows_too_little(method: str) -> None:
    fusion = HeadingFusion(method)
    rows_of(fusion, boat(20, heading_deg=350.0))
    rows = rows_of(fusion, boat(200, heading_deg=350.0, gps=(), compass=False, start_s=20))
    modes = [row.mode for row in rows]
    last = modes.index("invalid")
    assert modes[20:last] == ["dead-reckoning"] * (last - 20)
    assert set(modes[last:]) == {"invalid"}
    assert all(row.heading_sigma_deg <= 30 for row in rows[:last])
    assert all(math.isnan(row.heading_deg) and math.isnan(row.heading_sigma_deg) for row in rows[last:])
    assert max(abs(off(row.heading_deg, 350.0)) for row in rows[:last]) < 1.0


def test_silence_is_no_heading_and_leaves_no_gap_in_the_rows() -> None:
    fusion = HeadingFusion()
    before = rows_of(fusion, boat(10))
    after = rows_of(fusion, boat(10, start_s=30))
    stamps = [row.t_us for row in before + after]
    assert stamps == list(range(stamps[0], stamps[0] + 100_000 * len(stamps), 100_000))
    silent = [row for row in after if 11_200_000 < row.t_us < 30_000_000]
    assert len(silent) > 180
    assert {row.mode for row in silent} == {"invalid"}
    assert after[-1].mode == "ok"


def test_position_jumps_far_away_do_not_turn_the_heading() -> None:
    fusion = HeadingFusion("ekf-ci")
    rows_of(fusion, boat(20, heading_deg=80.0))
    far = [s._replace(lat_deg=s.lat_deg + 2) if isinstance(s, GpsSample) else s for s in boat(20, start_s=60)]
    turned = [s._replace(heading_deg=80.0) if isinstance(s, CompassSample) else s for s in far]
    rows = rows_of(fusion, iter(turned))
    assert rows[-1].pos_mode == "gps"
    assert rows[-1].lat_deg == pytest.approx(38.0, abs=0.01)
    assert not any(math.isnan(row.lat_deg) for row in rows[-20:])


def test_bad_receivers_leave_the_heading_to_the_compass() -> None:
    fusion = HeadingFusion()
    rows = rows_of(fusion, boat(20, heading_deg=120.0, hdop=30.0))
    assert rows[-1].weights == (0, 0, 0)
    assert rows[-1].gpsec_deg == pytest.approx(120.0, abs=1e-6)
    assert rows[-1].mode == "degraded"


def test_compass_without_variation_is_refused_with_a_notice() -> None:
    fusion = HeadingFusion(sources=("compass",))
    raw = [CompassSample(t * 100_000, COMPASS, 0, 90.0) for t in range(20)]
    assert all(row.mode == "invalid" for row in rows_of(fusion, iter(raw)))
    assert fusion.take_notices() == ["compass not used: the magnetic variation is unknown; set vessel.variation_deg"]
    assert fusion.take_notices() == []
    assert fusion.verdicts["no-variation"] == 20


def test_variation_and_deviation_are_east_positive() -> None:
    fusion = HeadingFusion(sources=("compass",), variation_deg=-8.0, deviation_deg=(2.0, 0, 0, 0, 0))
    raw = (CompassSample(t * 100_000, COMPASS, 0, 90.0) for t in range(20))
    assert rows_of(fusion, raw)[-1].gpsec_deg == pytest.approx(90 + 2 - 8)
    own = (CompassSample(t * 100_000, COMPASS, 0, 90.0, deviation_deg=-1.0) for t in range(20, 40))
    assert rows_of(fusion, own)[-1].gpsec_deg == pytest.approx(90 - 1 - 8)


def test_variation_of_the_model_is_asked_for_where_the_boat_is() -> None:
    fusion = HeadingFusion()
    raw = [s._replace(reference=0) if isinstance(s, CompassSample) else s for s in boat(5)]
    rows = rows_of(fusion, iter(raw))
    # WMM 2025 at 36 N, 126 E in autumn 2026: about 8.5 degrees west; the compass is at 0 deg true + nothing
    assert rows[-1].mode == "ok"
    assert fusion.verdicts["no-variation"] == 0
    compass_alone = rows_of(fusion, (CompassSample(t, COMPASS, 0, 0.0) for t in range(9_000_000, 12_000_000, 100_000)))
    assert off(compass_alone[-1].gpsec_deg, 0.0) == pytest.approx(-8.6, abs=0.5)


def test_time_running_backwards_is_dropped_with_a_notice() -> None:
    fusion = HeadingFusion()
    rows_of(fusion, boat(10))
    assert rows_of(fusion, boat(2)) == []
    assert fusion.verdicts["backwards"] > 0
    assert fusion.take_notices() == ["samples dropped: their time runs backwards"]


def test_nan_and_infinity_in_samples_reach_no_row() -> None:
    fusion = HeadingFusion()
    bad = (math.nan, math.inf, -math.inf, 1e300)
    for i, sample in enumerate(boat(20)):
        hurt = sample
        if i % 5 == 0:
            field = i // 5 % (len(sample) - 3) + 3
            hurt = type(sample)(
                *(bad[i % 4] if k == field and isinstance(v, float) else v for k, v in enumerate(sample))
            )
        for row in fusion.feed_records(hurt.pack()):
            numbers = (row.heading_deg, row.heading_sigma_deg)
            assert row.mode == "invalid" or all(map(math.isfinite, numbers))
    assert fusion.estimate is not None
    assert fusion.estimate.mode == "ok"


def test_samples_of_one_read_share_the_interval_before_them() -> None:
    spread, burst = HeadingFusion("cnw-ekf"), HeadingFusion("cnw-ekf")
    samples = list(boat(20, heading_deg=10.0, swing_deg=40.0))
    late: list[Sample] = []
    held: list[Sample] = []
    for sample in samples:  # the burst: five IMU samples at the stamp of the fifth
        if isinstance(sample, ImuSample):
            held.append(sample)
            if len(held) == 5:
                late += [s._replace(t_us=sample.t_us) for s in held]
                held = []
        else:
            late.append(sample)
    a, b = rows_of(spread, iter(samples))[-1], rows_of(burst, iter(late))[-1]
    assert abs(off(a.heading_deg, b.heading_deg)) < 0.6


def test_stopping_tasks_means_what_the_table_says() -> None:
    fusion = HeadingFusion("cnw3")
    rows_of(fusion, boat(10, heading_deg=30.0, hdop=3.0))
    fusion.set_task(10_000_000, "cnw-s1", False)
    assert rows_of(fusion, boat(2, heading_deg=30.0, start_s=10))[-1].weights == (1, 1, 1)
    fusion.set_task(12_000_000, "cnw-s1", True)
    fusion.set_task(12_000_000, "cnw-s2", False)
    assert math.isnan(rows_of(fusion, boat(2, heading_deg=30.0, start_s=12))[-1].gpsec_deg)
    fusion.set_task(14_000_000, "cnw-s2", True)
    fusion.set_task(14_000_000, "ekf1", False)
    row = rows_of(fusion, boat(2, heading_deg=30.0, start_s=14))[-1]
    assert math.isnan(row.ekf_deg[0])
    assert row.mode == "degraded"
    fusion.set_task(16_000_000, "cnw-s3", False)
    row = rows_of(fusion, boat(2, heading_deg=30.0, start_s=16))[-1]
    assert row.heading_deg == row.ekf_deg[1]
    fusion.set_task(18_000_000, "gps2", False)
    row = rows_of(fusion, boat(2, heading_deg=30.0, start_s=18))[-1]
    assert row.weights[1] == 0
    assert fusion.verdicts["stopped"] > 0
    for name in ("ekf1", "cnw-s3", "gps2"):
        fusion.set_task(20_000_000, name, True)
    assert rows_of(fusion, boat(3, heading_deg=30.0, start_s=20))[-1].mode == "ok"
    with pytest.raises(ValueError, match="gps9"):
        fusion.set_task(23_000_000, "gps9", False)


def test_mount_turns_the_imu_into_the_boat() -> None:
    upside_down = HeadingFusion("cnw3", sources=("compass", "imu"), mount_deg=(180, 0, 0))
    samples = [CompassSample(0, COMPASS, 1, 0.0)]
    turning = [ImuSample(t * 10_000, IMU, 0, 0, 0, 0, 0, 0, -6.0, 0, 0, -1) for t in range(1, 101)]
    upside_down.feed_records(b"".join(s.pack() for s in (*samples, *turning)))
    assert upside_down.estimate is not None
    assert upside_down.estimate.rate_of_turn_dps == pytest.approx(6.0)
    assert upside_down.estimate.heading_deg == pytest.approx(6.0, abs=0.01)


def test_specific_force_is_gravity_upside_down() -> None:
    rates = []
    for accel, sign in (("gravity", 1.0), ("specific-force", -1.0)):
        fusion = HeadingFusion(sources=("compass", "imu"), accel=accel)
        heeled = (math.sin(0.5), math.cos(0.5))  # 0.5 rad to starboard
        sample = ImuSample(0, IMU, 0, 0, 0, 0, 0, 0, 10.0, 0, sign * heeled[0], sign * heeled[1])
        fusion.feed_records(CompassSample(0, COMPASS, 1, 0.0).pack() + sample.pack())
        assert fusion.estimate is not None
        rates.append(fusion.estimate.rate_of_turn_dps)
    assert rates == [pytest.approx(10 * math.cos(0.5))] * 2


def test_options_are_checked() -> None:
    with pytest.raises(ValueError, match=r"method 'cnw4'; there are cnw-ekf, cnw3, ekf-ci"):
        HeadingFusion("cnw4")
    with pytest.raises(ValueError, match="source 'gps9'"):
        HeadingFusion(sources=("gps9",))
    with pytest.raises(ValueError, match="accel"):
        HeadingFusion(accel="up")
    with pytest.raises(ValueError, match="finite"):
        HeadingFusion(max_sigma_deg=math.nan)
    with pytest.raises(ValueError, match="whole number"):
        HeadingFusion().feed_records(b"123")


def test_any_number_of_receivers_works() -> None:
    for n in range(1, 9):
        fusion = HeadingFusion(n_gps=n)
        row = rows_of(fusion, boat(10, heading_deg=45.0, gps=tuple(range(n))))[-1]
        assert row.mode == "ok"
        assert row.weights == (3,) * n
        assert off(row.heading_deg, 45.0) == pytest.approx(0, abs=0.5)
    gap = HeadingFusion(sources=("gps1", "gps3", "compass", "imu"))
    row = rows_of(gap, boat(10, heading_deg=45.0))[-1]
    assert row.mode == "ok"
    assert math.isnan(row.weights[1])


def test_two_epochs_of_one_read_do_not_make_a_slow_receiver_stale() -> None:
    fusion = HeadingFusion(sources=("gps1",))
    stamps_s = [0.0, 1.0, 2.0, 4.0, 4.0, 5.05, 6.0, 6.99, 7.0, 8.05, 9.0]  # 3 s with 4 s; 7 s early behind 6 s
    samples = [
        GpsSample(round(t_s * 1e6), 0, 2, 1.79e9 + n, 36.0 + 3e-5 * n, 126.0, 0, SPEED_MPS, 0.0, 1.0)
        for n, t_s in enumerate(stamps_s)
    ]
    rows = rows_of(fusion, iter(samples))
    assert {row.mode for row in rows if row.t_us > 2_000_000} == {"ok"}


def stuck(samples: Iterator[Sample], source: int, from_s: float, to_s: float) -> Iterator[Sample]:
    """The samples of a boat, those of one source repeated from a moment to another."""
    last: dict[int, Sample] = {}
    for sample in samples:
        if sample.source == source and from_s <= sample.t_us / 1e6 < to_s:
            yield last[source]._replace(t_us=sample.t_us)
        else:
            last[sample.source] = sample
            yield sample


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("source", "within_s"), [(IMU, 1.3), (COMPASS, 3.0)])
def test_a_sensor_that_sticks_is_not_used_and_its_heading_not_called_ok(
    method: str, source: int, within_s: float
) -> None:
    fusion = HeadingFusion(method)
    rows = rows_of(fusion, stuck(boat(30, heading_deg=0.0, swing_deg=40.0), source, 10.0, 20.0))
    modes = {row.t_us / 1e6: row.mode for row in rows}
    assert {mode for t_s, mode in modes.items() if 5.0 < t_s < 10.0} == {"ok"}
    noticed = min(t_s for t_s, mode in modes.items() if t_s > 10.0 and mode == "degraded")
    assert noticed < 10.0 + within_s
    assert {mode for t_s, mode in modes.items() if noticed <= t_s < 20.0} == {"degraded"}
    assert {mode for t_s, mode in modes.items() if t_s > 20.3} == {"ok"}
    assert fusion.verdicts["stuck"] > 50
    assert "sticks at one value" in fusion.take_notices()[0]


def test_a_compass_that_repeats_itself_on_a_steady_course_is_believed() -> None:
    fusion = HeadingFusion()
    samples = boat(120, heading_deg=33.3)
    drifting = (s._replace(gyro_z_dps=0.8) if isinstance(s, ImuSample) else s for s in samples)  # a poor gyro's bias
    assert {row.mode for row in rows_of(fusion, drifting)[20:]} == {"ok"}


def test_a_lost_source_is_missing_at_once_until_it_speaks_again() -> None:
    fusion = HeadingFusion()
    rows_of(fusion, boat(5))
    fusion.lose(5_000_000, "gps2")
    at_once = fusion.estimate_at(5_000_000)
    assert (at_once.mode, at_once.weights[1]) == ("degraded", 0.0)
    assert {row.mode for row in rows_of(fusion, boat(2, gps=(0, 2), start_s=5))} == {"degraded"}
    assert rows_of(fusion, boat(2, start_s=7))[-1].mode == "ok"


def test_the_live_program_and_a_replay_to_a_file_need_no_numpy() -> None:
    code = "import sys; import tinyekf_py.run; sys.exit('numpy' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)

"""The adaptive method on simulated voyages, with comfortable margins; `docs/adaptive.md` has the figures."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from acquisition.decoder import make_decoder
from acquisition.sample import COMPASS, IMU, SOURCES
from acquisition.simulator.grades import GRADES
from acquisition.simulator.scenarios import scenario_named, settled
from acquisition.simulator.vessel import STEP_S
from acquisition.simulator.voyage import Voyage, antennas_m
from tinyekf_py.config import Config
from tinyekf_py.fusion import HeadingFusion
from tinyekf_py.fusion_config import AdaptiveConfig
from tinyekf_py.sample_array import sample_dtype


class Sailed(NamedTuple):
    """Samples of a voyage, and its truth ten times a second."""

    samples: NDArray[np.void]
    heading_deg: NDArray[np.float64]  #: true, unwrapped, every 0.1 s


class Errors(NamedTuple):
    """What the fusion made of it, after the first 20 s."""

    t_s: NDArray[np.float64]
    error_deg: NDArray[np.float64]
    sigma_deg: NDArray[np.float64]
    mode: NDArray[np.str_]

    @property
    def rmse_deg(self) -> float:
        return float(np.sqrt(np.mean(self.error_deg**2)))


@cache
def sailed(
    name: str,
    duration_s: float,
    *,
    circle_first: bool = True,
    seed: int = 1,
    gga_alone: bool = False,
    swing_deg: float = 0.0,
) -> Sailed:
    scenario = scenario_named(name)
    if swing_deg:  # as at anchor, to and fro in 90 s
        waters = scenario.waters
        scenario = replace(scenario, waters=replace(waters, sea=replace(waters.sea, period_s=90.0, yaw_deg=swing_deg)))
    voyage = Voyage(settled(scenario) if circle_first else scenario, GRADES["typical"], seed=seed)
    config = Config()
    decoders = {
        source: make_decoder(source, config.sensors[source].driver, config.decoder_options(source))
        for source in config.sources
    }
    records, headings = [], [voyage.motion.heading_deg]
    for step in range(1, round(duration_s / STEP_S) + 1):
        for t_us, source, line in voyage.advance():
            if gga_alone and source.startswith("gps") and not line.startswith(b"$GPGGA"):
                continue
            records += [sample.pack() for sample in decoders[source].decode(t_us, line)]
        if step % 10 == 0:
            headings.append(voyage.motion.heading_deg)
    samples = np.frombuffer(b"".join(records), sample_dtype)
    return Sailed(samples, np.unwrap(headings, period=360.0))


def errors(voyage: Sailed, *, without: tuple[str, ...] = (), method: str = "adaptive", **options: Any) -> Errors:
    fusion = HeadingFusion(method, variation_deg=-8.0, **options)
    gone = [SOURCES[name] for name in without]
    rows = fusion.run(voyage.samples[~np.isin(voyage.samples["source"], gone)])
    rows = rows[(rows["t_s"] > 20.0) & (rows["t_s"] <= 0.1 * (len(voyage.heading_deg) - 1))]
    truth = np.interp(rows["t_s"], 0.1 * np.arange(len(voyage.heading_deg)), voyage.heading_deg)
    error = (rows["heading_deg"] - truth + 180.0) % 360.0 - 180.0
    return Errors(rows["t_s"], error, rows["heading_sigma_deg"], rows["mode"])


def steps_deg(found: Errors) -> float:
    """The largest change of the error from one row to the next: a step that the boat did not make."""
    return float(np.max(np.abs(np.diff(found.error_deg))))


def test_heading_stays_true_and_continuous_across_north() -> None:
    found = errors(sailed("north", 240.0))
    assert found.rmse_deg < 1.0
    assert steps_deg(found) < 1.5


def test_a_boat_on_a_straight_course_is_known_better_than_by_any_sensor() -> None:
    found = errors(sailed("straight", 240.0))
    assert found.rmse_deg < 0.9
    assert np.mean(np.abs(found.error_deg) < 2.0 * found.sigma_deg) > 0.9


def test_sigma_contains_the_deviation_that_nothing_at_a_dock_can_see() -> None:
    found = errors(sailed("dock", 120.0, circle_first=False, seed=5))  # its deviation there is 4 degrees
    assert np.all(np.abs(found.error_deg) < 3.0 * found.sigma_deg)
    assert np.all(found.sigma_deg > 2.0)
    assert np.std(found.error_deg) < 1.0


def test_a_boat_that_swings_at_anchor_is_followed() -> None:
    found = errors(sailed("dock", 400.0, circle_first=False, swing_deg=15.0))
    assert found.rmse_deg < 2.0
    assert np.max(np.abs(found.error_deg)) < 4.0


def test_a_disturbed_compass_is_not_believed_and_is_taken_back_afterwards() -> None:
    voyage = sailed("magnetic", 440.0)  # with the circle before it, disturbed from about 306 to 416 s
    found = errors(voyage)
    disturbed = found.t_s > 300.0
    assert np.max(np.abs(found.error_deg[disturbed])) < 3.0
    alone = errors(voyage, without=("gps1", "gps2", "gps3"))
    assert np.max(np.abs(alone.error_deg[alone.t_s > 425.0])) < 8.0


def test_a_gps_that_lies_with_a_good_hdop_does_not_outvote_two() -> None:
    found = errors(sailed("faulty-gps", 240.0, circle_first=False, seed=2))
    assert found.rmse_deg < 1.5


def test_a_current_is_told_from_deviation_once_the_boat_has_turned() -> None:
    found = errors(sailed("current", 300.0))
    assert found.rmse_deg < 2.0
    after = found.t_s > 220.0  # a circle, a leg and a turn
    assert np.sqrt(np.mean(found.error_deg[after] ** 2)) < 2.0


def test_heading_goes_on_without_a_gyro() -> None:
    found = errors(sailed("lost-imu", 300.0, circle_first=False))
    assert found.rmse_deg < 2.5
    assert steps_deg(found) < 5.0
    assert set(found.mode[found.t_s > 122.0]) == {"degraded"}


def test_heading_goes_on_without_a_compass() -> None:
    found = errors(sailed("lost-compass", 240.0))
    assert found.rmse_deg < 1.2


def test_a_boat_without_compass_starts_by_her_course() -> None:
    found = errors(sailed("straight", 240.0), without=("compass",))
    assert np.isfinite(found.error_deg).all()
    assert found.rmse_deg < 1.5


def test_a_receiver_without_speed_and_course_shows_them_by_its_track() -> None:
    for name, duration_s in (("straight", 240.0), ("harbour", 300.0)):
        voyage = sailed(name, duration_s, gga_alone=True)
        gps = voyage.samples["source"] < COMPASS
        assert gps.any(), name
        assert np.isnan(voyage.samples["speed_mps"][gps]).all(), name
        found = errors(voyage)
        assert found.rmse_deg < 1.0, name
        assert np.mean(np.abs(found.error_deg) < 2.0 * found.sigma_deg) > 0.9, name
        assert found.rmse_deg < 0.6 * errors(voyage, without=("gps1", "gps2", "gps3")).rmse_deg, name


def test_compass_and_gyro_alone_make_a_heading_within_its_sigma() -> None:
    found = errors(sailed("straight", 240.0), without=("gps1", "gps2", "gps3"))
    assert np.isfinite(found.error_deg).all()
    assert np.mean(np.abs(found.error_deg) < 2.0 * found.sigma_deg) > 0.9


def test_gyro_alone_makes_no_heading() -> None:
    voyage = sailed("straight", 240.0)
    rows = HeadingFusion("adaptive").run(voyage.samples[voyage.samples["source"] == IMU])
    assert set(rows["mode"]) == {"invalid"}


def test_never_worse_than_the_papers_methods() -> None:
    for name in ("north", "lost-compass", "current"):
        voyage = sailed(name, 240.0 if name != "current" else 300.0)
        assert errors(voyage).rmse_deg < errors(voyage, method="cnw3").rmse_deg, name


def test_batches_do_not_change_the_estimate() -> None:
    samples = sailed("north", 240.0).samples[:8000]
    whole = HeadingFusion("adaptive", variation_deg=-8.0).run(samples)
    fusion = HeadingFusion("adaptive", variation_deg=-8.0)
    parts = np.concatenate([fusion.run(samples[i : i + 777]) for i in range(0, len(samples), 777)])
    assert whole.tobytes() == parts.tobytes()
    assert np.isin(COMPASS, samples["source"])


def test_the_position_is_that_of_the_boats_reference_point() -> None:
    samples = sailed("north", 240.0).samples[:20000]
    places_m = ((3.0, 1.0), (3.0, 1.0), (3.0, 1.0))
    there = HeadingFusion("adaptive", variation_deg=-8.0, antennas_m=places_m).run(samples)[-1]
    papers = HeadingFusion("cnw3", variation_deg=-8.0, antennas_m=places_m).run(samples)[-1]
    heading = np.radians(there["heading_deg"])
    north_m = (papers["lat_deg"] - there["lat_deg"]) * 111_000.0
    east_m = (papers["lon_deg"] - there["lon_deg"]) * 111_000.0 * np.cos(np.radians(there["lat_deg"]))
    assert north_m * np.cos(heading) + east_m * np.sin(heading) == pytest.approx(3.0, abs=0.05)
    assert east_m * np.cos(heading) - north_m * np.sin(heading) == pytest.approx(1.0, abs=0.05)


def test_what_a_turn_does_to_a_far_antenna_is_taken_off() -> None:
    """Receivers in the stern: the same voyage with all antennas moved 6 m aft, told and not told."""
    voyage = sailed("harbour", 300.0)
    samples = voyage.samples.copy()
    arm_m = -6.0
    rate = np.gradient(voyage.heading_deg, 0.1)
    gps = np.flatnonzero(samples["source"] < COMPASS)
    moment = samples["t_us"][gps] / 1e6 - 0.12
    grid = 0.1 * np.arange(len(voyage.heading_deg))
    heading = np.radians(np.interp(moment, grid, voyage.heading_deg))
    aside = arm_m * np.radians(np.interp(moment, grid, rate))
    course = np.radians(np.nan_to_num(samples["course_deg"][gps]))
    north = samples["speed_mps"][gps] * np.cos(course) - aside * np.sin(heading)
    east = samples["speed_mps"][gps] * np.sin(course) + aside * np.cos(heading)
    samples["speed_mps"][gps] = np.hypot(north, east)
    samples["course_deg"][gps] = np.degrees(np.arctan2(east, north)) % 360.0
    moved = voyage._replace(samples=samples)
    told = errors(moved, antennas_m=[(ahead + arm_m, to_starboard) for ahead, to_starboard in antennas_m()])
    assert told.rmse_deg < 1.0
    assert told.rmse_deg < 0.5 * errors(moved).rmse_deg


def test_what_is_believed_beforehand_can_be_configured() -> None:
    voyage = sailed("dock", 120.0, circle_first=False, seed=5)
    usual = errors(voyage)
    calibrated = errors(voyage, adaptive=AdaptiveConfig(deviation_sigma_deg=(0.3,) * 5, leeway_deg=0.0))
    assert np.mean(calibrated.sigma_deg) < 0.4 * np.mean(usual.sigma_deg)
    with pytest.raises(ValueError, match="out of range"):
        HeadingFusion("adaptive", adaptive=AdaptiveConfig(current_chance=1.0))


def test_a_configured_gyro_bias_is_taken_off_in_every_method() -> None:
    samples = sailed("north", 240.0).samples[:8000]
    bent = samples.copy()
    gyro = bent["gyro_dps"][bent["source"] == IMU] + np.array([1.0, -2.0, 3.0])
    bent["gyro_dps"][bent["source"] == IMU] = gyro
    for method in ("adaptive", "cnw3"):
        straight = HeadingFusion(method, variation_deg=-8.0).run(samples)
        mended = HeadingFusion(method, variation_deg=-8.0, gyro_bias_dps=(1.0, -2.0, 3.0)).run(bent)
        assert np.allclose(straight["heading_deg"], mended["heading_deg"], atol=1e-6, equal_nan=True), method


def test_mean_nis_tells_noise_that_is_too_small() -> None:
    samples = sailed("north", 240.0).samples[:8000]
    nis = {}
    for method in ("adaptive", "cnw3"):
        fusion = HeadingFusion(method, variation_deg=-8.0)
        assert np.isnan(fusion.mean_nis)
        fusion.run(samples)
        nis[method] = fusion.mean_nis
    assert 0.0 < nis["adaptive"] < 1.5
    assert nis["cnw3"] > 3.0  # the papers' R is far too small for forward azimuth

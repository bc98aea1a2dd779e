"""GPS sentences to epochs: when an epoch closes, and what it says."""

from __future__ import annotations

import math
from datetime import UTC, datetime

import pytest
from gps_lines import LAT, LON, feed, gga, gsa, nmea, rmc, started, vtg

from acquisition.gps import GpsDecoder
from acquisition.sample import GpsSample

# -- when an epoch closes


def test_the_first_epoch_closes_when_the_next_utc_comes_and_the_others_with_their_last_sentence() -> None:
    lines = [gga("030000.00"), rmc("030000.00"), gga("030000.10"), rmc("030000.10"), gga("030000.20"), rmc("030000.20")]
    assert [sample.t_us for sample in feed(GpsDecoder(0), lines)] == [3000, 4000, 6000]


def test_an_epoch_says_what_its_sentences_say_together() -> None:
    decoder, samples = started(gga("030000.00", quality="2"), rmc("030000.00", end=",8.2,W,D"))
    (sample,) = samples
    assert sample.source == 0
    assert sample.fix_quality == 2
    assert sample.utc_s == datetime(2026, 11, 24, 3, tzinfo=UTC).timestamp()
    assert sample.lat_deg == pytest.approx(35 + 57.60156 / 60, abs=1e-12)
    assert sample.lon_deg == pytest.approx(126 + 31.19962 / 60, abs=1e-12)
    assert sample.altitude_m == 12.3
    assert sample.speed_mps == pytest.approx(7.379 * 1852 / 3600, abs=1e-12)
    assert sample.course_deg == 27.39
    assert sample.hdop == 1.04
    assert sample.variation_deg == -8.2
    assert sample.satellites == 8
    assert not set(decoder.counts) - {"lines", "samples"}


def test_south_and_west_are_negative() -> None:
    (sample,) = started(nmea("GPGGA,030000.00,3557.6,S,12631.2,W,1,08,1.0,0,M,0,M,,"), rmc("030000.00"))[1]
    assert sample.lat_deg == pytest.approx(-35.96)
    assert sample.lon_deg == pytest.approx(-126.52)


def test_rmc_alone_makes_an_epoch() -> None:
    samples = feed(GpsDecoder(0), [rmc("030000.00"), rmc("030000.10"), rmc("030000.20")])
    assert [sample.t_us for sample in samples] == [2000, 2000, 3000]
    assert samples[0].fix_quality == 1
    assert math.isnan(samples[0].hdop)
    assert samples[0].satellites == -1


def test_gga_and_vtg_make_an_epoch_for_a_receiver_without_rmc() -> None:
    lines = [gga("030000.00"), vtg(), gga("030000.10"), vtg("6.00", "78.0"), gga("030000.20"), vtg()]
    samples = feed(GpsDecoder(0), lines)
    assert [sample.t_us for sample in samples] == [3000, 4000, 6000]
    assert samples[1].speed_mps == pytest.approx(6 * 1852 / 3600)
    assert samples[1].course_deg == 78.0
    assert math.isnan(samples[1].utc_s)


def test_speed_and_course_come_from_rmc_where_both_speak() -> None:
    (sample,) = started(gga("030000.00"), vtg(), rmc("030000.00"))[1]
    assert sample.course_deg == 27.39


@pytest.mark.parametrize(
    ("lines", "talks"),
    [
        ([gga("030000.00"), gsa("0.95"), rmc("030000.00")], 0.95),
        ([gga("030000.00"), gsa(""), rmc("030000.00")], 1.04),
        ([gga("030000.00"), gsa("0.95"), gsa("0.99"), rmc("030000.00")], 0.95),
    ],
)
def test_hdop_is_that_of_gsa_else_of_gga(lines: list[bytes], talks: float) -> None:
    (sample,) = started(*lines)[1]
    assert sample.hdop == talks


def test_a_gsa_that_ends_the_epoch_is_waited_for_and_never_leaks_into_the_next() -> None:
    lines: list[bytes] = []
    for i in range(4):
        lines += [gga(f"030000.{i}0"), rmc(f"030000.{i}0"), gsa(f"1.{i}0")]
    samples = feed(GpsDecoder(0), lines)
    assert [sample.hdop for sample in samples] == [1.0, 1.1, 1.2, 1.3]
    assert [sample.t_us for sample in samples] == [4000, 6000, 9000, 12000]


def test_a_gsa_that_begins_the_burst_belongs_to_what_follows_the_pause() -> None:
    decoder = GpsDecoder(0)
    samples: list[GpsSample] = []
    for i in range(5):
        burst = [gsa(f"1.{i}0"), gga(f"030000.{i}0"), rmc(f"030000.{i}0")]
        samples += feed(decoder, burst, start_us=i * 100_000)
    # Until the period is known, the pause cannot be told: the second GSA still counts for the first epoch.
    assert [sample.hdop for sample in samples[-2:]] == [1.3, 1.4]
    assert [sample.t_us for sample in samples[-2:]] == [303_000, 403_000]


def test_a_lost_closing_sentence_delays_its_own_epoch_only() -> None:
    _, samples = started(gga("030000.00"), gga("030000.10"), rmc("030000.10"), gga("030000.20"), rmc("030000.20"))
    assert [sample.t_us for sample in samples] == [102_000, 103_000, 105_000]
    assert math.isnan(samples[0].speed_mps)
    assert not math.isnan(samples[1].speed_mps)


def test_a_new_order_of_sentences_is_learned() -> None:
    lines: list[bytes] = []
    for i in range(6):
        lines += [rmc(f"030000.{i}0"), gga(f"030000.{i}0")]
    _, samples = started(*lines)
    assert [sample.t_us for sample in samples[-3:]] == [108_000, 110_000, 112_000]
    assert all(sample.hdop == 1.04 and sample.speed_mps > 0 for sample in samples[-3:])


def test_one_line_can_close_two_epochs() -> None:
    _, samples = started(gga("030000.00"), rmc("030000.10"))
    assert [(sample.t_us, round(sample.utc_s % 60, 2)) for sample in samples] == [(102_000, 0.0), (102_000, 0.1)]


def test_the_second_talker_of_one_solution_changes_nothing() -> None:
    lines = [gga("030000.00"), gga("030000.00", talker="GA", used="01"), rmc("030000.00")]
    decoder, samples = started(*lines)
    assert [sample.satellites for sample in samples] == [8]
    assert decoder.counts["samples"] == 3


def test_times_rounded_differently_are_one_epoch() -> None:
    gll = nmea(f"GPGLL,{LAT},{LON},030000.303,A")
    (sample,) = started(gll, gga("030000.30"), rmc("030000.30"))[1]
    assert sample.utc_s % 60 == pytest.approx(0.30)


def test_gll_and_gns_carry_an_epoch_where_nothing_better_does() -> None:
    gll = [nmea(f"GPGLL,{LAT},{LON},03000{i},A,D") for i in range(3)]
    samples = feed(GpsDecoder(0), gll)
    assert [sample.fix_quality for sample in samples] == [2, 2, 2]
    gns = [nmea(f"GNGNS,03000{i}.00,{LAT},{LON},AR,15,0.8,12.3,25.1,,,V") for i in range(3)]
    samples = feed(GpsDecoder(0), gns)
    assert [(s.fix_quality, s.hdop, s.satellites, s.altitude_m) for s in samples] == [(4, 0.8, 15, 12.3)] * 3


# -- quality and void epochs


@pytest.mark.parametrize(
    ("status", "end", "quality"),
    [
        (status, f",,,{mode}", q)
        for status, mode, q in zip("AAAAAAAAA", "ADPRFEMSN", (1, 2, 3, 4, 5, 6, 7, 8, 0), strict=True)
    ]
    + [("A", ",,", 1), ("V", ",,,A", 0), ("V", ",,", 0)],
)
def test_without_gga_the_quality_is_the_mode_of_rmc(status: str, end: str, quality: int) -> None:
    (sample,) = started(rmc("030000.00", status=status, end=end))[1]
    assert sample.fix_quality == quality
    assert math.isnan(sample.lat_deg) == (quality == 0)


def test_a_void_epoch_is_a_sample_without_a_position_even_if_numbers_stand_there() -> None:
    for lines in (
        [gga("030000.00"), rmc("030000.00", status="V", end=",,,N")],
        [gga("030000.00", quality="0"), rmc("030000.00", status="V")],
        [gga("030000.00", quality="0", lat="8960.0000,N"), rmc("030000.00", status="V", lat="36000.0000,N")],
    ):
        decoder, samples = started(*lines)
        (sample,) = samples
        assert sample.fix_quality == 0
        for value in (sample.lat_deg, sample.lon_deg, sample.altitude_m, sample.speed_mps, sample.course_deg):
            assert math.isnan(value)
        assert sample.utc_s == datetime(2026, 11, 24, 3, tzinfo=UTC).timestamp()
        assert decoder.counts["malformed"] == 0


def test_a_receiver_that_knows_no_time_yet_lives() -> None:
    burst = [nmea("GPRMC,,V,,,,,,,,,,N"), nmea("GPVTG,,,,,,,,,N"), nmea("GPGGA,,,,,,0,00,99.99,,,,,,")]
    decoder = GpsDecoder(0)
    samples = feed(decoder, burst * 4)
    assert len(samples) == 4
    assert all(sample.fix_quality == 0 and math.isnan(sample.utc_s) for sample in samples)
    assert decoder.counts["repeated"] == 0


def test_a_blank_course_at_rest_is_missing() -> None:
    (sample,) = started(gga("030000.00"), rmc("030000.00", course=""))[1]
    assert math.isnan(sample.course_deg)
    assert sample.speed_mps > 0


def test_a_course_of_360_is_0() -> None:
    (sample,) = started(gga("030000.00"), rmc("030000.00", course="360.0"))[1]
    assert sample.course_deg == 0.0

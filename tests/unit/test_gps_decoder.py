"""GPS sentences to epochs: when an epoch closes, what it says, and what is dropped."""

from __future__ import annotations

import math
from collections.abc import Iterable
from datetime import UTC, datetime

import pytest

from acquisition.gps import GpsDecoder
from acquisition.sample import GpsSample

LAT, LON = "3557.60156,N", "12631.19962,E"


def nmea(body: str) -> bytes:
    checksum = 0
    for character in body:
        checksum ^= ord(character)
    return f"${body}*{checksum:02X}".encode()


def gga(
    utc: str, *, lat: str = LAT, quality: str = "1", hdop: str = "1.04", talker: str = "GP", used: str = "08"
) -> bytes:
    return nmea(f"{talker}GGA,{utc},{lat},{LON},{quality},{used},{hdop},12.3,M,25.1,M,,")


def rmc(
    utc: str, *, status: str = "A", course: str = "27.39", date: str = "241126", end: str = ",,,A", lat: str = LAT
) -> bytes:
    return nmea(f"GPRMC,{utc},{status},{lat},{LON},7.379,{course},{date}{end}")


def gsa(hdop: str = "0.95") -> bytes:
    return nmea(f"GPGSA,A,3,02,04,07,,,,,,,,,,1.71,{hdop},1.38")


def vtg(knots: str = "5.20", course: str = "77.5") -> bytes:
    return nmea(f"GPVTG,{course},T,,M,{knots},N,9.7,K,A")


def feed(decoder: GpsDecoder, lines: Iterable[bytes], start_us: int = 0, step_us: int = 1000) -> list[GpsSample]:
    """Feeds the lines `step_us` apart; the first is stamped `start_us` + `step_us`."""
    samples: list[GpsSample] = []
    for i, line in enumerate(lines, 1):
        samples += decoder.decode(start_us + i * step_us, line)
    return samples


def started(*lines: bytes, rhythm: Iterable[bytes] | None = None) -> tuple[GpsDecoder, list[GpsSample]]:
    """A decoder that has learned the rhythm GGA, RMC from two epochs before 03:00:00, and what `lines` give then."""
    decoder = GpsDecoder(0)
    feed(decoder, rhythm or [gga("025959.80"), rmc("025959.80"), gga("025959.90"), rmc("025959.90")])
    return decoder, feed(decoder, lines, start_us=100_000)


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


# -- date and time


def test_utc_is_unknown_until_a_date_comes_and_rolls_over_midnight_without_one() -> None:
    decoder = GpsDecoder(0)
    first = feed(decoder, [gga("235958.00"), gga("235959.00")])
    assert all(math.isnan(sample.utc_s) for sample in first)
    decoder.decode(1, nmea("GPZDA,235959.00,31,12,2026,00,00"))
    later = feed(decoder, [gga("000000.00"), gga("000001.00")])
    midnight = datetime(2027, 1, 1, tzinfo=UTC).timestamp()
    assert [sample.utc_s for sample in later] == [midnight, midnight + 1]
    assert decoder.counts["backwards"] == 0


def test_a_date_that_does_not_exist_is_missing_and_the_position_stands() -> None:
    samples = feed(GpsDecoder(0), [rmc("030000.00", date="2208-1"), rmc("030001.00", date="310226")])
    assert all(math.isnan(sample.utc_s) and not math.isnan(sample.lat_deg) for sample in samples)


def test_two_digit_years_from_80_are_of_the_last_century() -> None:
    _, (sample, *_) = (
        GpsDecoder(0),
        feed(GpsDecoder(0), [rmc("000000.00", date="060180"), rmc("000001.00", date="060180")]),
    )
    assert sample.utc_s == datetime(1980, 1, 6, tzinfo=UTC).timestamp()


def test_a_time_that_goes_back_is_dropped() -> None:
    decoder, samples = started(
        gga("030000.00"), rmc("030000.00"), gga("025950.00"), rmc("025950.00"), gga("030000.10"), rmc("030000.10")
    )
    assert [round(sample.utc_s % 60, 2) for sample in samples] == [0.0, 0.1]
    assert decoder.counts["backwards"] == 1


def test_a_clock_that_was_set_back_is_believed_after_three_epochs() -> None:
    lines: list[bytes] = []
    for i in range(6):
        lines += [gga(f"02300{i}.00"), rmc(f"02300{i}.00")]
    decoder, samples = started(*lines)
    assert [sample.utc_s % 60 for sample in samples] == [2, 3, 4, 5]
    assert decoder.counts["backwards"] == 2


# -- repeated epochs


def test_an_epoch_repeated_to_the_letter_is_dropped_once() -> None:
    epoch = [gga("030000.00"), rmc("030000.00")]
    decoder, samples = started(*epoch, *epoch, gga("030000.10"), rmc("030000.10"))
    assert len(samples) == 2
    assert decoder.counts["repeated"] == 1


def test_the_first_epoch_repeated_to_the_letter_is_dropped_too() -> None:
    decoder = GpsDecoder(0)
    epoch = [gga("030000.00"), rmc("030000.00")]
    assert len(feed(decoder, [*epoch, *epoch, gga("030000.10"), rmc("030000.10")])) == 2
    assert decoder.counts["repeated"] == 1


def test_a_repeated_utc_with_another_position_is_an_epoch() -> None:
    other = "3557.60200,N"
    decoder, samples = started(
        gga("030000.00"), rmc("030000.00"), gga("030000.00", lat=other), rmc("030000.00", lat=other)
    )
    assert [sample.lat_deg for sample in samples] == pytest.approx([35 + 57.60156 / 60, 35 + 57.602 / 60])
    assert decoder.counts["repeated"] == 0


def test_a_standing_receiver_is_not_repeating() -> None:
    decoder, samples = started(gga("030000.00"), rmc("030000.00"), gga("030000.10"), rmc("030000.10"))
    assert len(samples) == 2
    assert decoder.counts["repeated"] == 0


# -- bad input


@pytest.mark.parametrize(
    "line",
    [
        gga("250000.00"),
        gga("036000.00"),
        gga("0300"),
        gga("nan"),
        gga("030000.00", lat="9100.0,N"),
        gga("030000.00", lat="3560.0,N"),
        gga("030000.00", lat="-3557.6,N"),
        gga("030000.00", lat="3557.6,E"),
        gga("030000.00", lat="nan,N"),
        gga("030000.00", lat="3557_6,N"),
        gga("030000.00", hdop="inf"),
        gga("030000.00", hdop="-1"),
        gga("030000.00", quality="x"),
        gga("030000.00", quality="42"),
        rmc("030000.00", course="720"),
        rmc("030000.00", course="-1"),
        rmc("030000.00", status="X"),
        rmc("030000.00", end=",,,A,V,1,2"),
        nmea("GPGGA,030000.00,3557.6,N"),
        gsa("nan"),
        vtg("-1"),
        nmea("GPVTG,1,2"),
        nmea("GPZDA,990000,01,01,2026"),
        b"$GPGGA,030000.00,3557.60156,N,126",
        b"$GPGGA,030000.00*4",
        b"\x00\xff\x80\x01noise",
        b"$GP\xffGA,030000.00*00",
        b"$",
        b"",
        b"xyz",
    ],
)
def test_a_bad_line_is_counted_and_the_next_epoch_is_read(line: bytes) -> None:
    decoder, samples = started(line, gga("030000.00"), rmc("030000.00"))
    assert len(samples) == 1
    assert decoder.counts["malformed"] + decoder.counts["checksum"] == 1
    assert decoder.last_error.startswith(("malformed: ", "checksum: "))
    assert "\n" not in decoder.last_error


def test_checksums_are_required_in_either_case_of_hex_unless_switched_off() -> None:
    good = [nmea(f"GPRMC,03000{i}.00,A,{LAT},{LON},7.379,27.4,241126,,,A") for i in range(4)]
    lower = [line[:-2] + line[-2:].lower() for line in good]
    assert len(feed(GpsDecoder(0), lower)) == 4
    wrong = [line[:-2] + b"00" for line in good]
    strict, lenient = GpsDecoder(0), GpsDecoder(0, checksum=False)
    assert feed(strict, [*wrong, *(line[:-3] for line in good)]) == []
    assert strict.counts["checksum"] == 8
    assert len(feed(lenient, [*wrong[:2], *(line[:-3] for line in good[2:])])) == 4
    assert lenient.counts["unverified"] == 2


@pytest.mark.parametrize("kind", ["HCHDM,123.4,M", "HEHDT,1.0,T", "GNTHS,1.0,A", "APXDR,A,1.0,D,PTCH", "HCHDG,1.0,,,,"])
def test_a_compass_on_the_gps_port_is_foreign(kind: str) -> None:
    decoder = GpsDecoder(0)
    assert decoder.decode(1, nmea(kind)) == ()
    assert decoder.decode(2, b"*1.49,1.97,-5.44") == ()
    assert decoder.counts == {"lines": 2, "foreign": 2}


def test_other_sentences_of_a_gps_are_unused() -> None:
    decoder = GpsDecoder(0)
    for line in (nmea("GPGSV,1,1,00"), nmea("PUBX,00,1"), nmea("GNGBS,1"), b"# a comment $GPGGA"):
        assert decoder.decode(1, line) == ()
    assert decoder.counts == {"lines": 4, "unused": 4}


def test_a_sentence_is_found_behind_half_a_sentence_or_noise() -> None:
    _, samples = started(b"$GPGSV,3,3,09,88," + gga("030000.00"), b"\xb5\x62\x00$" + rmc("030000.00"))
    assert len(samples) == 1
    assert samples[0].hdop == 1.04
    assert samples[0].course_deg == 27.39


def test_decoding_is_a_function_of_stamps_and_lines_alone() -> None:
    lines: list[bytes] = []
    for i in range(10):
        lines += [gsa(), gga(f"03000{i}.00"), vtg(), rmc(f"03000{i}.00")]
    assert repr(feed(GpsDecoder(2), lines)) == repr(feed(GpsDecoder(2), lines))


def test_sentences_without_a_time_ahead_of_their_epoch_go_with_it() -> None:
    decoder = GpsDecoder(0)
    samples: list[GpsSample] = []
    for second in range(8):
        burst = vtg(course=f"{second}.0"), gsa(f"1.{second}"), gga(f"03000{second}.00")
        samples += feed(decoder, burst, start_us=second * 1_000_000)
    for sample in samples[-4:]:
        second = round(sample.t_us / 1e6)
        assert sample.utc_s != sample.utc_s or round(sample.utc_s) % 60 == second
        assert (sample.course_deg, sample.hdop) == (second, 1.0 + second / 10)
    assert samples[-1].t_us // 1_000_000 == 7


def test_sentences_without_a_time_alone_do_not_gather() -> None:
    decoder, _ = started(gga("030000.00"), vtg(), rhythm=[])
    feed(decoder, (gga(f"03000{second}.00") for second in range(1, 4)), start_us=1_000_000, step_us=1_000_000)
    feed(decoder, [vtg()] * 5000, start_us=10_000_000, step_us=1_000_000)
    assert len(decoder._early) <= 8

"""GPS sentences to epochs: dates that come late, clocks that jump, epochs repeated, lines that are none."""

from __future__ import annotations

import math
from datetime import UTC, datetime

import pytest
from gps_lines import LAT, LON, feed, gga, gsa, nmea, rmc, started, vtg

from acquisition.gps import GpsDecoder
from acquisition.sample import GpsSample

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

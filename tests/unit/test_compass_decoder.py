"""The compass: one sample for each heading sentence, tilt attached."""

from __future__ import annotations

import math

import pynmea2
import pytest

from acquisition.compass import CompassDecoder
from acquisition.sample import COMPASS, REFERENCE_COMPASS, REFERENCE_TRUE, CompassSample


def nmea(body: str) -> bytes:
    checksum = 0
    for character in body:
        checksum ^= ord(character)
    return f"${body}*{checksum:02X}".encode()


def decode(body: str) -> CompassSample:
    (sample,) = CompassDecoder().decode(1, nmea(body))
    return sample


def test_hdm_is_a_compass_heading() -> None:
    (sample,) = CompassDecoder().decode(68_566, b"$HCHDM,123.4,M*2D")
    assert sample[:4] == (68_566, COMPASS, REFERENCE_COMPASS, 123.4)
    assert all(math.isnan(value) for value in sample[4:])


@pytest.mark.parametrize("body", ["HEHDT,244.65,T", "GNTHS,244.65,A", "GNTHS,244.65,E"])
def test_hdt_and_ths_are_true(body: str) -> None:
    sample = decode(body)
    assert (sample.reference, sample.heading_deg) == (REFERENCE_TRUE, 244.65)


def test_ths_is_registered_with_pynmea2() -> None:
    sentence = pynmea2.parse(nmea("GNTHS,244.65,A").decode(), check=True)
    assert (sentence.heading, sentence.mode) == ("244.65", "A")


@pytest.mark.parametrize(
    ("fields", "deviation_deg", "variation_deg"),
    [("1.5,E,8.2,W", 1.5, -8.2), ("1.5,W,8.2,E", -1.5, 8.2), (",,0.6,E", math.nan, 0.6), (",,,", math.nan, math.nan)],
)
def test_hdg_carries_its_own_deviation_and_variation(fields: str, deviation_deg: float, variation_deg: float) -> None:
    sample = decode(f"HCHDG,181.7,{fields}")
    assert (sample.reference, sample.heading_deg) == (REFERENCE_COMPASS, 181.7)
    assert sample.deviation_deg == pytest.approx(deviation_deg, nan_ok=True)
    assert sample.variation_deg == pytest.approx(variation_deg, nan_ok=True)


@pytest.mark.parametrize(("text", "heading_deg"), [("0", 0.0), ("360.0", 0.0), ("359.9", 359.9), ("-10.5", 349.5)])
def test_headings_are_in_0_to_360(text: str, heading_deg: float) -> None:
    assert decode(f"HCHDM,{text},M").heading_deg == heading_deg


@pytest.mark.parametrize("body", ["IIHDT,,T", "IIHDM,,M", "IITHS,123.4,V", "HCHDG,,,,,"])
def test_a_compass_without_a_heading_still_lives(body: str) -> None:
    assert math.isnan(decode(body).heading_deg)


def test_pitch_and_roll_go_with_the_next_heading_once() -> None:
    decoder = CompassDecoder()
    assert decoder.decode(1, nmea("APXDR,A,0.135,D,PTCH")) == ()
    assert decoder.decode(2, nmea("YXXDR,C,21.5,C,TEMP,A,-3.861,D,ROLL")) == ()
    (first,) = decoder.decode(3, nmea("APHDM,163.2,M"))
    (second,) = decoder.decode(4, nmea("APHDM,163.3,M"))
    assert (first.pitch_deg, first.roll_deg) == (0.135, -3.861)
    assert math.isnan(second.pitch_deg)
    assert math.isnan(second.roll_deg)
    assert decoder.counts == {"lines": 4, "samples": 2}


def test_other_transducers_and_sentences_are_unused() -> None:
    decoder = CompassDecoder()
    for body in ("YXXDR,C,21.5,C,TEMP", "APROT,0.0,A", "HCMTW,17.9,C", "PTNTHPR,354.9,N,5.2,N,0.2,N"):
        assert decoder.decode(1, nmea(body)) == ()
    assert decoder.counts == {"lines": 4, "unused": 4}


@pytest.mark.parametrize(
    "body",
    [
        "HCHDM,720.0,M",
        "HCHDM,nan,M",
        "HCHDM,inf,M",
        "HCHDM,1_2,M",
        "HCHDM,12x,M",
        "HCHDM,123.4",
        "HCHDM,123.4,M,1",
        "HCHDM,123.4,T",
        "HCHDT,123.4,M",
        "HCTHS,123.4,Q",
        "HCHDG,181.7,,,0.6",
        "HCHDG,181.7,1.0,,0.6,E",
        "HCHDG,181.7,1.0,X,0.6,E",
        "HCHDG,181.7,,,999,E",
        "APXDR,A,95.0,D,PTCH",
        "APXDR,A,nan,D,ROLL",
        "APXDR,A,1.0,D",
    ],
)
def test_a_sentence_that_cannot_be_true_is_malformed(body: str) -> None:
    decoder = CompassDecoder()
    assert decoder.decode(1, nmea(body)) == ()
    assert decoder.counts == {"lines": 1, "malformed": 1}
    assert len(decoder.decode(2, nmea("HCHDM,123.4,M"))) == 1


def test_checksums_are_required_unless_switched_off() -> None:
    strict, lenient = CompassDecoder(), CompassDecoder(checksum=False)
    lines = [b"$HCHDM,123.4,M", b"$HCHDM,123.4,M*00", b"$HCHDM,123.4,M*2d"]
    assert [len(strict.decode(1, line)) for line in lines] == [0, 0, 1]
    assert strict.counts["checksum"] == 2
    assert [len(lenient.decode(1, line)) for line in lines] == [1, 1, 1]
    assert lenient.counts["unverified"] == 1


@pytest.mark.parametrize(
    "line",
    [
        nmea("GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,"),
        b"!AIVDM,1,1,1,,13aI8e?P00PGpU:NR6s00?vT2000,0,0*1C",
        b"*1.49,1.97,-5.44",
    ],
)
def test_another_device_on_the_compass_port_is_foreign(line: bytes) -> None:
    decoder = CompassDecoder()
    assert decoder.decode(1, line) == ()
    assert decoder.counts == {"lines": 1, "foreign": 1}

"""Whatever a port sends, a decoder counts it and goes on; what it does give out can be true."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce
from operator import xor

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition.compass import CompassDecoder
from acquisition.decoder import Decoder, make_decoder
from acquisition.ebimu import EbimuAsciiDecoder, EbimuHexDecoder
from acquisition.gps import GpsDecoder
from acquisition.sample import CompassSample, GpsSample, ImuSample, Sample, unpack

KINDS = ["GGA", "RMC", "VTG", "GSA", "GLL", "GNS", "ZDA", "HDM", "HDG", "HDT", "THS", "XDR", "GSV", "TXT", "QQQ"]
FIELDS = [
    *("", "0", "1", "A", "V", "N", "S", "E", "W", "M", "T", "D", "3557.6", "12631.2", "030000.00", "030001.00"),
    *("235959.99", "241126", "08", "1.04", "nan", "inf", "-inf", "-1", "1e9", "1E400", "0x10", "1_0", " 1", "\u00b2"),
    *("360", "720", "PTCH", "ROLL", "9" * 400, "-0", "+5", ".", "-", "2026", "11", "24"),
]
REASONS = {"checksum", "malformed", "foreign", "unused", "backwards", "repeated"}


def sentence(talker: str, kind: str, fields: list[str], right: bool) -> bytes:
    body = ",".join([talker + kind, *fields]).encode("latin-1")
    checksum = reduce(xor, body, 0) if right else 0
    return b"$" + body + b"*%02X" % checksum


sentences = st.builds(
    sentence,
    st.sampled_from(["GP", "GN", "HC", "P", "", "gp"]),
    st.sampled_from(KINDS),
    st.lists(st.sampled_from(FIELDS), max_size=18),
    st.booleans() | st.just(True),
)
good = st.sampled_from(
    [
        b"$GPGGA,030000.00,3557.60156,N,12631.19962,E,2,08,1.04,12.3,M,25.1,M,,*65",
        b"$GPRMC,030000.00,A,3557.60156,N,12631.19962,E,7.379,27.39,241126,,,A*4C",
        b"$HCHDM,123.4,M*2D",
        b"*1.49,1.97,-5.44,7.27,0.48,1.92,-0.027,0.041,0.994",
    ]
)


@st.composite
def damaged(draw: st.DrawFn) -> bytes:
    """A good line with a piece cut out, doubled, or overwritten."""
    line = draw(good)
    start = draw(st.integers(0, len(line)))
    end = draw(st.integers(start, len(line)))
    return line[:start] + draw(st.binary(max_size=4) | st.just(line[start:end] * 2)) + line[end:]


imu_lines = st.lists(st.sampled_from(FIELDS), max_size=14).map(lambda f: b"*" + ",".join(f).encode("latin-1"))
hex_lines = st.binary(max_size=26).map(lambda body: b"\x55\x55" + body)
lines = st.lists(
    st.tuples(st.integers(0, 300_000), sentences | damaged() | good | imu_lines | hex_lines | st.binary(max_size=120)),
    max_size=40,
)


def check_sample(sample: Sample) -> None:
    if isinstance(sample, GpsSample):
        assert -1 <= sample.fix_quality <= 9
        assert math.isnan(sample.lat_deg) or -90 <= sample.lat_deg <= 90
        assert math.isnan(sample.lon_deg) or -180 <= sample.lon_deg <= 180
        assert math.isnan(sample.course_deg) or 0 <= sample.course_deg < 360
        assert math.isnan(sample.speed_mps) or sample.speed_mps >= 0
    elif isinstance(sample, CompassSample):
        assert math.isnan(sample.heading_deg) or 0 <= sample.heading_deg < 360
        assert math.isnan(sample.pitch_deg) or -90 <= sample.pitch_deg <= 90
    assert not any(math.isinf(value) for value in sample)
    assert unpack(sample.pack())[:3] == sample[:3]


def run(decoder: Decoder, stream: Sequence[tuple[int, bytes]]) -> list[Sample]:
    t_us = 0
    samples: list[Sample] = []
    for step_us, line in stream:
        t_us += step_us
        for sample in decoder.decode(t_us, line):
            assert sample.t_us == t_us
            check_sample(sample)
            samples.append(sample)
    assert decoder.counts["lines"] == len(stream)
    assert decoder.counts["samples"] == len(samples)
    assert not set(decoder.counts) - REASONS - {"lines", "samples", "unverified"}
    assert "\n" not in decoder.last_error
    return samples


@pytest.mark.parametrize(
    ("source", "driver", "options"),
    [
        ("gps1", "nmea", {}),
        ("gps1", "nmea", {"checksum": False}),
        ("compass", "nmea", {}),
        ("compass", "nmea", {"checksum": False}),
        ("imu", "ebimu-ascii", {}),
        ("imu", "ebimu-ascii", {"groups": "mag,accel"}),
        ("imu", "ebimu-hex", {}),
    ],
)
@settings(max_examples=150, deadline=None)
@given(stream=lines)
def test_any_stream_is_decoded_to_possible_samples_and_always_to_the_same(
    source: str, driver: str, options: dict[str, object], stream: list[tuple[int, bytes]]
) -> None:
    first = run(make_decoder(source, driver, options), stream)
    assert repr(run(make_decoder(source, driver, options), stream)) == repr(first)


@settings(max_examples=100, deadline=None)
@given(stream=lines)
def test_after_any_stream_each_decoder_still_reads_good_lines(stream: list[tuple[int, bytes]]) -> None:
    def nmea(body: str) -> bytes:
        return b"$%s*%02X" % (body.encode(), reduce(xor, body.encode(), 0))

    hex_frame = b"\x55\x55" + bytes(18) + b"\x00\xaa"
    gps_lines = [nmea(f"GPRMC,12000{i}.00,A,3557.6,N,12631.2,E,7.4,27.4,241126,,,A") for i in range(8)]
    for decoder, healthy in [
        (GpsDecoder(0), gps_lines),
        (CompassDecoder(), [b"$HCHDM,123.4,M*2D"]),
        (EbimuAsciiDecoder(), [b"*1,2,3,4,5,6,0,0,1"]),
        (EbimuHexDecoder(), [hex_frame]),
    ]:
        run(decoder, stream)  # type: ignore[arg-type]
        samples: list[Sample] = []
        for i, line in enumerate(healthy):
            samples += decoder.decode(10**9 + i * 100_000, line)
        assert samples
        last = samples[-1]
        if isinstance(last, GpsSample):
            assert last.lat_deg == pytest.approx(35.96)
        elif isinstance(last, CompassSample):
            assert last.heading_deg == 123.4
        else:
            assert isinstance(last, ImuSample)


@settings(max_examples=100, deadline=None)
@given(chunks=st.lists(st.binary(max_size=60) | st.sampled_from([b"\n", b"\r\n", b"\x55\x55", b"x" * 600])))
def test_framing_takes_any_bytes_and_stays_small(chunks: list[bytes]) -> None:
    for framing in (EbimuAsciiDecoder().framing(), EbimuHexDecoder().framing()):
        taken = 0
        for chunk in chunks:
            taken += len(chunk)
            assert all(len(line) <= 1024 for line in framing.feed(chunk))
        assert max(framing.dropped.values(), default=0) <= taken

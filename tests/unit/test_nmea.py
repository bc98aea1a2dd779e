"""NMEA 0183 sentences: the standard's form, what they say in every mode, and that other people's parsers agree."""

from __future__ import annotations

import math
import re
from decimal import Decimal
from typing import Any

import pynmea2
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pynmeagps import VALCKSUM, NMEAReader

import acquisition.nmea  # noqa: F401  # registers THS
from tinyekf_py.alarms import NUMBERS, Alarm
from tinyekf_py.estimate import MODES, POSITION_MODES, Estimate
from tinyekf_py.outputs.nmea import FORMATTERS, MAX_SENTENCE, Report, alarm_sentence, report_of, sentences
from tinyekf_py.outputs.nmea_stream import AlarmStream, split
from tinyekf_py.outputs.settings import SENTENCES
from tinyekf_py.view_state import Navigation, ViewState

NAN = float("nan")
UTC_S = 1_795_550_355.25  # 2026-11-24 19:59:15.25
ESTIMATE = Estimate(1_000_000, 123.456, 0.5, -1.5, 35.96, 126.52, "ok", "gps")
NAVIGATION = Navigation(UTC_S, 5.0, 121.5, 12.34, 1, 9, 0.93, 3.21, -0.04, -8.0, 2.0)
REPORT = Report(ESTIMATE, NAVIGATION, simulated=False)


class ALR(pynmea2.TalkerSentence):  # type: ignore[misc]
    """Registered with pynmea2, which lacks it, by its existence; THS is so by `acquisition.nmea`."""

    fields = (("Time", "timestamp"), ("Number", "number"), ("Raised", "raised"), ("Known", "known"), ("Text", "text"))


def said(report: Report, *formatters: str) -> str:
    """The sentence of the formatter, or of all, without address and checksum."""
    lines = [line.decode() for _, line in sentences("GP", formatters or FORMATTERS, report)]
    return " ".join(re.sub(r"\*[0-9A-F]{2}\r\n$", "", line).partition(",")[2] for line in lines)


def with_estimate(**changes: Any) -> Report:
    return REPORT._replace(estimate=ESTIMATE._replace(**changes))


def with_navigation(**changes: Any) -> Report:
    return REPORT._replace(navigation=NAVIGATION._replace(**changes))


def test_a_whole_sentence_has_address_checksum_and_line_ending() -> None:
    # A receiver maker's own example.
    assert sentences("GP", ["HDT"], with_estimate(heading_deg=274.07)) == [("HDT", b"$GPHDT,274.07,T*03\r\n")]
    assert sentences("HE", ["HDT"], REPORT)[0][1].startswith(b"$HEHDT,123.46,T*")


def test_every_sentence_that_the_configuration_knows_can_be_made() -> None:
    assert {*FORMATTERS, "ALR"} == set(SENTENCES)


@pytest.mark.parametrize(
    ("formatter", "fields"),
    [
        ("HDT", "123.46,T"),
        ("THS", "123.46,A"),
        ("HDM", "131.46,M"),
        ("HDG", "131.46,,,8.00,W"),
        ("ROT", "-90.0,A"),
        ("XDR", "A,0.0,D,PITCH,A,3.2,D,ROLL"),
        ("GGA", "195915.25,3557.60000,N,12631.20000,E,1,09,0.9,12.3,M,,,,"),
        ("RMC", "195915.25,A,3557.60000,N,12631.20000,E,9.7,121.50,241126,8.00,W,A"),
    ],
)
def test_a_sentence_says_what_is_known(formatter: str, fields: str) -> None:
    assert said(REPORT, formatter) == fields


def test_hdg_with_the_deviation_is_what_its_listener_adds_up_to_the_same_heading() -> None:
    assert said(REPORT._replace(send_deviation=True), "HDG") == "129.46,2.00,E,8.00,W"
    west = with_navigation(deviation_deg=-3.25)._replace(send_deviation=True)
    assert said(west, "HDG") == "134.71,3.25,W,8.00,W"


@pytest.mark.parametrize(
    ("mode", "simulated", "ths"),
    [("ok", False, "A"), ("degraded", False, "A"), ("dead-reckoning", False, "E"), ("dead-reckoning", True, "S")],
)
def test_ths_tells_how_the_heading_was_found(mode: str, simulated: bool, ths: str) -> None:
    report = with_estimate(mode=mode)._replace(simulated=simulated)
    assert said(report, "THS") == f"123.46,{ths}"


@pytest.mark.parametrize("change", [{"mode": "invalid"}, {"heading_deg": NAN}])
def test_a_heading_that_is_gone_is_never_a_number(change: dict[str, Any]) -> None:
    report = with_estimate(**change)
    assert said(report, "THS") == ",V"
    assert said(report, "HDT", "HDM", "HDG") == ""


@pytest.mark.parametrize(
    ("pos_mode", "fix_quality", "simulated", "quality", "status", "mode"),
    [
        ("gps", 1, False, "1", "A", "A"),
        ("gps", 2, False, "2", "A", "D"),
        ("gps", 4, False, "2", "A", "D"),
        ("gps", -1, False, "1", "A", "A"),
        ("dead-reckoning", 2, False, "6", "V", "E"),
        ("gps", 2, True, "8", "V", "S"),
        ("dead-reckoning", 2, True, "8", "V", "S"),
        ("invalid", 2, False, "0", "V", "N"),
        ("invalid", 2, True, "0", "V", "N"),
    ],
)
def test_a_position_says_what_it_rests_on(
    pos_mode: str, fix_quality: int, simulated: bool, quality: str, status: str, mode: str
) -> None:
    report = Report(ESTIMATE._replace(pos_mode=pos_mode), NAVIGATION._replace(fix_quality=fix_quality), simulated)
    gga, rmc = said(report, "GGA").split(","), said(report, "RMC").split(",")
    assert (gga[5], rmc[1], rmc[11]) == (quality, status, mode)
    assert all(gga[1:5]) == all(rmc[2:6]) == (pos_mode != "invalid")


def test_a_turn_to_starboard_is_positive_and_an_unknown_one_void() -> None:
    assert said(with_estimate(rate_of_turn_dps=2.0), "ROT") == "120.0,A"
    assert said(with_estimate(rate_of_turn_dps=-0.0001), "ROT") == "0.0,A"
    assert said(with_estimate(rate_of_turn_dps=NAN), "ROT") == ",V"


def test_what_is_missing_is_empty() -> None:
    bare = Report(ESTIMATE, Navigation(), simulated=False)
    assert said(bare, "GGA") == ",3557.60000,N,12631.20000,E,1,,,,,,,,"
    assert said(bare, "RMC") == ",A,3557.60000,N,12631.20000,E,,,,,,A"
    assert said(bare, "XDR", "HDM", "HDG") == ""
    assert said(with_navigation(pitch_deg=NAN), "XDR") == "A,3.2,D,ROLL"
    assert said(with_navigation(cog_deg=NAN), "RMC").split(",")[6:8] == ["9.7", ""]


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg", "fields"),
    [
        (-0.5, -0.5, "0030.00000,S,00030.00000,W"),
        (59.99999999, 179.99999999, "6000.00000,N,18000.00000,E"),
        (0.0, 359.5, "0000.00000,N,00030.00000,W"),
        (-90.0, -180.0, "9000.00000,S,18000.00000,W"),
    ],
)
def test_positions_at_the_edges(lat_deg: float, lon_deg: float, fields: str) -> None:
    assert fields in said(with_estimate(lat_deg=lat_deg, lon_deg=lon_deg), "GGA")


def test_a_heading_never_reads_360() -> None:
    assert said(with_estimate(heading_deg=359.9951), "HDT", "THS") == "0.00,T 0.00,A"


def test_a_midnight_is_not_24_hours() -> None:
    assert said(with_navigation(utc_s=1_795_564_799.998), "RMC").split(",")[0] == "000000.00"


def test_the_report_of_a_stale_state_holds_nothing() -> None:
    state = ViewState(ESTIMATE, 0.1, navigation=NAVIGATION)
    assert report_of(state, 0.5).navigation == NAVIGATION
    stale = report_of(state, 0.95)
    assert stale.estimate.mode == "invalid"
    assert said(stale) == ",V ,V ,,,,,0,,,,,,,, ,V,,,,,,,,,,N"
    assert said(report_of(None, math.inf), "THS") == ",V"


def test_sentences_without_a_mark_stay_here_in_a_simulation() -> None:
    lines = sentences("GP", FORMATTERS, REPORT._replace(simulated=True))
    chunk = split(lines, unmarked_stay=True)
    everywhere, here = chunk.everywhere.decode(), chunk.here.decode()
    assert re.findall("GP([A-Z]{3})", everywhere) == ["THS", "GGA", "RMC"]
    assert re.findall("GP([A-Z]{3})", here) == ["HDT", "HDG", "HDM", "ROT", "XDR"]
    assert split(lines, unmarked_stay=False) == (b"".join(line for _, line in lines), b"")


def test_an_alarm_tells_when_it_was_raised_and_some_times_that_it_has_gone() -> None:
    stream = AlarmStream("GP")
    alarm = Alarm("heading-degraded", "warning", "heading degraded: gps1 missing, imu stopped", 90.0)
    state = ViewState(ESTIMATE, elapsed_s=100.0, navigation=NAVIGATION)
    raised = b"$GPALR,195905.25,002,A,V,heading degraded: gps1 missing; imu stopped*"
    for _ in range(5):
        (line,) = stream.sentences([alarm], state, 0.0)
        assert line.startswith(raised)
    for _ in range(3):
        (line,) = stream.sentences([], state, 0.5)
        assert line.startswith(b"$GPALR,195915.75,002,V,V,heading degraded")
    assert stream.sentences([], state, 0.5) == []


def check(line: bytes) -> None:
    """What the standard asks of every sentence, and that two strangers read it."""
    assert len(line) <= MAX_SENTENCE, line
    assert re.fullmatch(rb"\$[A-Z]{5}(,[ -#%-)+\--~]*)+\*[0-9A-F]{2}\r\n", line), line
    parsed = pynmea2.parse(line.decode(), check=True)
    assert type(parsed).__name__ == line[3:6].decode()
    other = NMEAReader.parse(line, validate=VALCKSUM)
    assert other.msgID == line[3:6].decode()


anything = st.floats(allow_nan=True, allow_infinity=True)


@given(
    st.builds(
        Report,
        st.builds(
            Estimate,
            st.just(0),
            *(anything,) * 3,
            st.floats(-91, 91) | anything,
            st.floats(-361, 361) | anything,
            st.sampled_from(MODES),
            st.sampled_from(POSITION_MODES),
        ),
        st.builds(
            Navigation,
            st.floats(0, 4e9) | anything,
            st.floats(0, 600) | anything,
            anything,
            st.floats(-500, 9000) | st.just(NAN),
            st.integers(-1, 9),
            st.integers(-1, 2**31 - 1),
            st.floats(0, 200) | anything,
            *(st.floats(-180, 180) | st.just(NAN),) * 4,
        ),
        st.booleans(),
        st.booleans(),
    )
)
def test_whatever_is_known_every_sentence_is_well_formed(report: Report) -> None:
    for _, line in sentences("GP", FORMATTERS, report):
        check(line)


@given(st.sampled_from(sorted(NUMBERS)), st.text(max_size=200), st.floats(0, 4e9) | anything, st.booleans())
def test_whatever_an_alarm_says_its_sentence_is_well_formed(alarm: str, text: str, utc_s: float, raised: bool) -> None:
    check(alarm_sentence("GP", alarm, text, utc_s, raised=raised))


def test_strangers_read_the_same_numbers() -> None:
    lines = dict(sentences("GP", FORMATTERS, REPORT))
    rmc = NMEAReader.parse(lines["RMC"])
    assert (rmc.lat, rmc.lon, rmc.status) == (pytest.approx(35.96), pytest.approx(126.52), "A")
    assert (rmc.spd, rmc.cog) == (pytest.approx(9.7), pytest.approx(121.5))
    assert str(rmc.date) == "2026-11-24"
    gga = pynmea2.parse(lines["GGA"].decode(), check=True)
    assert (gga.latitude, gga.longitude) == (pytest.approx(35.96), pytest.approx(126.52))
    assert gga.gps_qual == 1
    assert pynmea2.parse(lines["THS"].decode(), check=True).heading == "123.46"
    hdg = pynmea2.parse(lines["HDG"].decode(), check=True)
    assert (hdg.heading, hdg.variation, hdg.var_dir) == (Decimal("131.46"), Decimal("8.00"), "W")
    assert NMEAReader.parse(lines["ROT"]).rot == pytest.approx(-90.0)

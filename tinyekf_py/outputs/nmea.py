"""NMEA 0183 sentences of a view state: pure functions, from what is known to lines with checksum and CR LF.

What is missing is an empty field; what is invalid is said where the sentence has a word for it (THS, ROT, GGA, RMC),
and otherwise not sent (HDT, HDM, HDG, XDR). THS, GGA and RMC can say that they are simulated (`MARKED`). All others
look in a simulation or a replay like those of a real boat, and are for this machine alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime
from math import isfinite
from typing import NamedTuple

from tinyekf_py.alarms import NUMBERS
from tinyekf_py.estimate import Estimate
from tinyekf_py.view_state import Navigation, ViewState, current_estimate

#: Sentences that say so when their contents are simulated.
MARKED = frozenset({"THS", "GGA", "RMC"})
MAX_SENTENCE = 82  #: characters, from $ to LF
_KNOT_MPS = 1852.0 / 3600.0
#: What may not stand in a text, for it has a meaning in the line.
_RESERVED = frozenset("$*!\\^~")


class Report(NamedTuple):
    """All that sentences are made of, at one moment."""

    estimate: Estimate  #: an invalid one when there is none, or when it is too old
    navigation: Navigation  #: as old as the estimate
    simulated: bool  #: no real boat
    send_deviation: bool = False  #: HDG says the compass' deviation, which its listeners add


def report_of(state: ViewState | None, waited_s: float, *, send_deviation: bool = False) -> Report:
    """The report `waited_s` seconds after `state` was made (None: nothing has come yet)."""
    estimate = current_estimate(state, waited_s) if state is not None else Estimate(0)
    if state is None or estimate is not state.estimate:  # too old: so is all that stands beside it
        return Report(Estimate(0), Navigation(), state is not None and state.simulated, send_deviation)
    return Report(estimate, state.navigation, state.simulated, send_deviation)


def sentence(talker: str, formatter: str, *fields: str) -> bytes:
    """`$`, address, fields, checksum, CR LF."""
    body = ",".join((talker + formatter, *fields)).encode("ascii", "replace")
    checksum = 0
    for byte in body:
        checksum ^= byte
    return b"$%s*%02X\r\n" % (body, checksum)


def sentences(talker: str, formatters: Iterable[str], report: Report) -> list[tuple[str, bytes]]:
    """The sentences of `formatters` (of `FORMATTERS`) that the report has something for, each with its formatter."""
    made = []
    for formatter in formatters:
        fields = FORMATTERS[formatter](report)
        if fields:
            made.append((formatter, sentence(talker, formatter, *fields)))
    return made


def alarm_sentence(talker: str, alarm_id: str, text: str, utc_s: float, *, raised: bool) -> bytes:
    """ALR: an alarm that was raised, or has gone, at `utc_s` (seconds since 1970), never acknowledged."""
    clock, _ = _utc(utc_s)
    words = "".join(c if " " <= c <= "~" and c not in _RESERVED else " " for c in text.replace(",", ";"))
    room = MAX_SENTENCE - len(sentence(talker, "ALR", clock, "000", "A", "V", ""))
    return sentence(talker, "ALR", clock, f"{NUMBERS[alarm_id]:03d}", "A" if raised else "V", "V", words[:room])


def _hdt(report: Report) -> Sequence[str]:
    """True heading."""
    heading = _degrees(report.estimate.heading_deg) if _has_heading(report) else ""
    return (heading, "T") if heading else ()


def _ths(report: Report) -> Sequence[str]:
    """True heading and its mode: autonomous, estimated, simulator, void."""
    if not _has_heading(report):
        return "", "V"
    mode = "S" if report.simulated else "E" if report.estimate.mode == "dead-reckoning" else "A"
    return _degrees(report.estimate.heading_deg), mode


def _hdm(report: Report) -> Sequence[str]:
    """Magnetic heading."""
    heading = _degrees(report.estimate.heading_deg - report.navigation.variation_deg) if _has_heading(report) else ""
    return (heading, "M") if heading else ()


def _hdg(report: Report) -> Sequence[str]:
    """Magnetic heading, less the deviation that follows and that a listener adds; variation."""
    variation_deg = report.navigation.variation_deg
    if not _has_heading(report) or not isfinite(variation_deg):
        return ()
    magnetic_deg = report.estimate.heading_deg - variation_deg
    deviation_deg = report.navigation.deviation_deg
    if not report.send_deviation or not isfinite(deviation_deg):
        return _degrees(magnetic_deg), "", "", *_signed(variation_deg, "EW")
    return _degrees(magnetic_deg - deviation_deg), *_signed(deviation_deg, "EW"), *_signed(variation_deg, "EW")


def _rot(report: Report) -> Sequence[str]:
    """Rate of turn, degrees a minute, negative to port."""
    rate_dps = report.estimate.rate_of_turn_dps
    rate = _number(60.0 * rate_dps, 1) if report.estimate.mode != "invalid" else ""
    return rate, "A" if rate else "V"


def _xdr(report: Report) -> Sequence[str]:
    """Pitch (bow up) and roll (starboard down)."""
    fields: list[str] = []
    for name, angle_deg in (("PITCH", report.navigation.pitch_deg), ("ROLL", report.navigation.roll_deg)):
        if isfinite(angle_deg):
            fields += ("A", _number(angle_deg, 1), "D", name)
    return fields


def _position_mode(report: Report) -> str:
    """What the position rests on, as RMC's mode: A or D (GPS), E (dead reckoning), S (simulated), N (none)."""
    if not _has_position(report):
        return "N"
    if report.simulated:
        return "S"
    if report.estimate.pos_mode != "gps":
        return "E"
    return "D" if report.navigation.fix_quality >= 2 else "A"


#: RMC's mode -> GGA's quality.
_QUALITIES = {"A": "1", "D": "2", "E": "6", "S": "8", "N": "0"}


def _gga(report: Report) -> Sequence[str]:
    """Position, what it rests on, and height: quality 1 or 2 (GPS), 6 (dead reckoning), 8 (simulated), 0 (none)."""
    navigation = report.navigation
    clock, _ = _utc(navigation.utc_s)
    quality = _QUALITIES[_position_mode(report)]
    satellites = f"{min(navigation.satellites, 99):02d}" if navigation.satellites >= 0 else ""
    altitude = _number(navigation.altitude_m, 1)
    return (
        *(clock, *_position(report), quality, satellites),
        *(_number(navigation.hdop, 1) if navigation.hdop < 100.0 else "", altitude, "M" if altitude else ""),
        *("", "", "", ""),
    )


def _rmc(report: Report) -> Sequence[str]:
    """Position, speed and course over ground, date. Its status is A only for a real fix."""
    navigation = report.navigation
    clock, date = _utc(navigation.utc_s)
    mode = _position_mode(report)
    speed = _number(navigation.sog_mps / _KNOT_MPS, 1) if 0.0 <= navigation.sog_mps < 500.0 else ""
    return (
        *(clock, "A" if mode in ("A", "D") else "V", *_position(report)),
        *(speed, _degrees(navigation.cog_deg), date, *_signed(navigation.variation_deg, "EW"), mode),
    )


#: Formatter -> the fields of its sentence; none when there is nothing to say.
FORMATTERS: dict[str, Callable[[Report], Sequence[str]]] = {
    "HDT": _hdt, "THS": _ths, "HDG": _hdg, "HDM": _hdm, "ROT": _rot, "XDR": _xdr, "GGA": _gga, "RMC": _rmc,
}  # fmt: skip


def _has_heading(report: Report) -> bool:
    return report.estimate.mode != "invalid" and isfinite(report.estimate.heading_deg)


def _has_position(report: Report) -> bool:
    estimate = report.estimate
    return estimate.pos_mode != "invalid" and abs(estimate.lat_deg) <= 90.0 and abs(estimate.lon_deg) <= 360.0


def _degrees(angle_deg: float) -> str:
    """A bearing with two decimals in [0, 360); empty when unknown."""
    if not isfinite(angle_deg):
        return ""
    text = f"{angle_deg % 360.0:.2f}"
    return "0.00" if text == "360.00" else text


def _number(value: float, decimals: int) -> str:
    """A number; empty when unknown or absurd, and never minus zero."""
    if not abs(value) < 100_000.0:
        return ""
    text = f"{value:.{decimals}f}"
    return text.lstrip("-") if float(text) == 0.0 else text


def _signed(angle_deg: float, sides: str) -> tuple[str, str]:
    """An angle without its sign, and its side; empty when unknown."""
    if not isfinite(angle_deg):
        return "", ""
    return f"{abs(angle_deg):.2f}", sides[angle_deg < 0.0]


def _position(report: Report) -> tuple[str, str, str, str]:
    """Latitude and longitude in degrees and minutes to about 2 cm; empty without a position."""
    if not _has_position(report):
        return "", "", "", ""
    lat_deg, lon_deg = report.estimate.lat_deg, (report.estimate.lon_deg + 180.0) % 360.0 - 180.0
    return _minutes(lat_deg, 2), "NS"[lat_deg < 0.0], _minutes(lon_deg, 3), "EW"[lon_deg < 0.0]


def _minutes(angle_deg: float, digits: int) -> str:
    degrees, hundred_thousandths = divmod(round(abs(angle_deg) * 6_000_000), 6_000_000)
    minutes, rest = divmod(hundred_thousandths, 100_000)
    return f"{degrees:0{digits}d}{minutes:02d}.{rest:05d}"


def _utc(utc_s: float) -> tuple[str, str]:
    """hhmmss.ss and ddmmyy; empty when unknown."""
    try:
        hundredths = round(utc_s * 100.0)
        when = datetime.fromtimestamp(hundredths // 100, UTC)
    except (ValueError, OverflowError, OSError):  # unknown, or a year that no calendar has
        return "", ""
    return f"{when:%H%M%S}.{hundredths % 100:02d}", f"{when:%d%m%y}"

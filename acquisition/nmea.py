"""One NMEA 0183 sentence: from a line to its kind and its checked fields.

pynmea2 takes the sentence apart and checks its sum. Its own typed properties are not used: they are slow, and where a
field is no number they return it as text. The fields are converted here instead, strictly: a value that is there and
cannot be true raises ValueError, which condemns the whole sentence; a blank one is missing (NaN).
"""

from __future__ import annotations

from collections import Counter

import pynmea2

from .sample import NAN


class THS(pynmea2.TalkerSentence):  # type: ignore[misc]  # pynmea2 has no types
    """True heading and status: the sentence that replaces HDT, unknown to pynmea2. Defining it here registers it."""

    fields = (
        ("Heading, degrees true", "heading"),
        ("Mode indicator (A autonomous, E estimated, M manual, S simulator, V not valid)", "mode"),
    )


class SentenceError(ValueError):
    """A line that is not used; `reason` is the counter it belongs to ("checksum", "malformed")."""

    def __init__(self, reason: str, message: str) -> None:
        super().__init__(message)
        self.reason = reason


def read_sentence(line: bytes, checksum: bool, counts: Counter[str]) -> tuple[str, list[str]]:
    """The kind (three letters, any talker) and the fields of the sentence in `line`; SentenceError otherwise.

    What stands before the line's last ``$`` is the rest of a sentence that was cut short, or noise: it is passed over.
    A proprietary sentence has the kind "P", a comment (``#``) the kind "#"; neither has fields. With `checksum` a
    sentence without a right one is refused; without, it is taken, and one with a wrong sum is counted in `counts` as
    "unverified".
    """
    start = line.rfind(b"$")
    if start > 0:
        if line[0] == 35:  # '#'
            return "#", []
        line = line[start:]
    elif start < 0:
        if line[:1] == b"#":
            return "#", []
        raise SentenceError("malformed", "no sentence begins in it")
    if line[1:2] in (b"P", b"p"):
        return "P", []
    if b"_" in line:  # which float() would read over
        raise SentenceError("malformed", "a character that no sentence has")
    try:
        text = line.decode("ascii")
        sentence = pynmea2.NMEASentence.parse(text, checksum)
    except pynmea2.ChecksumError:
        if checksum:
            raise SentenceError("checksum", "the checksum is missing or wrong") from None
        counts["unverified"] += 1
        return read_sentence(line.partition(b"*")[0], False, counts)
    except pynmea2.SentenceTypeError:
        return line[3:6].decode("ascii").upper(), []
    except ValueError:  # pynmea2's ParseError, or a byte outside ASCII
        raise SentenceError("malformed", "not the form of a sentence") from None
    if isinstance(sentence, pynmea2.TalkerSentence):
        return sentence.sentence_type, sentence.data
    return "Q", []


def number(text: str, low: float, high: float) -> float:
    """The number in a field, within `low` to `high`, both included; NaN where the field is blank."""
    if not text:
        return NAN
    value = float(text)
    if low <= value <= high:
        return value
    raise ValueError(f"{text} is outside {low:g} to {high:g}")


def angle_deg(text: str) -> float:
    """A course or heading in degrees, 0 to 360, with 360 as 0; NaN where the field is blank."""
    if not text:
        return NAN
    value = float(text)
    if 0.0 <= value < 360.0:
        return value
    if value == 360.0:
        return 0.0
    raise ValueError(f"the angle {text} is outside 0 to 360 degrees")


def signed_deg(text: str, side: str, limit_deg: float = 180.0) -> float:
    """A variation or deviation with its side, east positive, in degrees; NaN where the field is blank."""
    if not text:
        return NAN
    value = float(text)
    if -limit_deg <= value <= limit_deg:
        if side == "E":
            return value
        if side == "W":
            return -value
    raise ValueError(f"{text},{side} is no angle to the east or west")


def latitude_deg(text: str, side: str) -> float:
    """``ddmm.mmmm`` and N or S as degrees, north positive; NaN where both fields are blank."""
    if not text:
        return NAN
    value = float(text)
    degrees = value // 100.0
    minutes = value - 100.0 * degrees
    if 0.0 <= value <= 9000.0 and minutes < 60.0:
        if side == "N":
            return degrees + minutes / 60.0
        if side == "S":
            return -(degrees + minutes / 60.0)
    raise ValueError(f"{text},{side} is no latitude")


def longitude_deg(text: str, side: str) -> float:
    """``dddmm.mmmm`` and E or W as degrees, east positive; NaN where both fields are blank."""
    if not text:
        return NAN
    value = float(text)
    degrees = value // 100.0
    minutes = value - 100.0 * degrees
    if 0.0 <= value <= 18000.0 and minutes < 60.0:
        if side == "E":
            return degrees + minutes / 60.0
        if side == "W":
            return -(degrees + minutes / 60.0)
    raise ValueError(f"{text},{side} is no longitude")


def time_of_day_s(text: str) -> float | None:
    """``hhmmss.sss`` as seconds since midnight UTC (a leap second reads 60); None where the field is blank."""
    if not text:
        return None
    clock = text[:6]
    if len(clock) == 6 and clock.isdigit():
        hours = int(clock[:2])
        minutes = int(clock[2:4])
        seconds = float(text[4:])
        if hours < 24 and minutes < 60 and seconds < 61.0:
            return hours * 3600 + minutes * 60 + seconds
    raise ValueError(f"{text} is no time of day")

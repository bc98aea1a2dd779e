"""Compass: each heading sentence becomes one sample.

HDM and HDG read as the instrument does (deviation and variation are applied later); HDT and THS are true already.
Pitch and roll come in XDR sentences of their own, of any talker: they go with the next heading, once. A compass that
says it has no heading (a blank field, THS in mode V) still gives a sample, with the heading missing: it lives.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from .framing import LineFraming
from .nmea import SentenceError, read_sentence, signed_deg
from .sample import COMPASS, NAN, REFERENCE_COMPASS, REFERENCE_TRUE, CompassSample

_PITCH = frozenset({"PTCH", "PITCH"})
_ROLL = frozenset({"ROLL", "HEEL"})
_OTHER_DEVICES = frozenset({"GGA", "RMC", "VTG", "GSA", "GSV", "GLL", "GNS", "ZDA"})


class CompassDecoder:
    """Decodes the lines of one NMEA 0183 compass.

    Reasons in `counts` for which a line gives nothing: "checksum", "malformed", "foreign" (another kind of device
    speaks), "unused" (a sentence that says nothing of heading, pitch or roll).
    """

    def __init__(self, *, checksum: bool = True) -> None:
        """`checksum`: whether a sentence needs a right one."""
        self.counts: Counter[str] = Counter()
        self.last_error = ""
        self._checksum = checksum
        self._pitch_deg = NAN
        self._roll_deg = NAN

    def framing(self) -> LineFraming:
        """A fresh framing for this compass's port."""
        return LineFraming()

    def decode(self, t_us: int, line: bytes) -> Sequence[CompassSample]:
        """The sample of a heading sentence received at `t_us` microseconds; nothing for any other line."""
        self.counts["lines"] += 1
        try:
            if line[:1] in (b"!", b"*"):
                raise SentenceError("foreign", "AIS, or an IMU, speaks on a compass port")
            kind, fields = read_sentence(line, self._checksum, self.counts)
            reference = REFERENCE_TRUE
            deviation_deg = variation_deg = NAN
            if kind == "HDM":
                _expect(kind, fields, 2, "M")
                heading_deg = _heading_deg(fields[0])
                reference = REFERENCE_COMPASS
            elif kind == "HDG":
                if len(fields) != 5:
                    raise ValueError(f"HDG has 5 fields, not {len(fields)}")
                heading_deg = _heading_deg(fields[0])
                deviation_deg = signed_deg(fields[1], fields[2])
                variation_deg = signed_deg(fields[3], fields[4])
                reference = REFERENCE_COMPASS
            elif kind == "HDT":
                _expect(kind, fields, 2, "T")
                heading_deg = _heading_deg(fields[0])
            elif kind == "THS":
                _expect(kind, fields, 2, "AEMSV")
                heading_deg = _heading_deg(fields[0])
                if fields[1] == "V":
                    heading_deg = NAN
            elif kind == "XDR":
                self._read_attitude(fields)
                return ()
            elif kind in _OTHER_DEVICES:
                raise SentenceError("foreign", f"{kind} comes from a GPS")
            else:
                self.counts["unused"] += 1
                return ()
        except SentenceError as error:
            return self._refuse(error.reason, line, str(error))
        except ValueError as error:
            return self._refuse("malformed", line, str(error))
        sample = CompassSample(
            t_us, COMPASS, reference, heading_deg, deviation_deg, variation_deg, self._pitch_deg, self._roll_deg
        )
        self._pitch_deg = self._roll_deg = NAN
        self.counts["samples"] += 1
        return (sample,)

    def _refuse(self, reason: str, line: bytes, why: str) -> tuple[()]:
        self.counts[reason] += 1
        self.last_error = f"{reason}: {why}: {line[:82]!r}"
        return ()

    def _read_attitude(self, fields: list[str]) -> None:
        """Pitch (bow up) and roll (starboard down) of an XDR: groups of type, value, unit and name."""
        if len(fields) % 4:
            raise ValueError(f"XDR has groups of 4 fields, not {len(fields)} fields")
        pitch_deg, roll_deg = self._pitch_deg, self._roll_deg
        found = False
        for i in range(0, len(fields), 4):
            transducer, value, unit, name = fields[i : i + 4]
            if transducer != "A" or unit != "D":
                continue
            name = name.upper()
            if name in _PITCH:
                pitch_deg = _tilt_deg(value, 90.0)
                found = True
            elif name in _ROLL:
                roll_deg = _tilt_deg(value, 180.0)
                found = True
        if not found:
            self.counts["unused"] += 1
        self._pitch_deg, self._roll_deg = pitch_deg, roll_deg


def _expect(kind: str, fields: list[str], count: int, last: str) -> None:
    """Refuses a sentence with another number of fields, or a last field not in `last` (blank is permitted)."""
    if len(fields) != count:
        raise ValueError(f"{kind} has {count} fields, not {len(fields)}")
    if len(fields[-1]) > 1 or fields[-1] not in last:
        raise ValueError(f"the last field of {kind} is one of {', '.join(last)}, not {fields[-1]}")


def _heading_deg(text: str) -> float:
    """A heading in [0, 360); instruments that count from -180 to 180 are understood. NaN where the field is blank."""
    if not text:
        return NAN
    value = float(text)
    if 0.0 <= value < 360.0:
        return value
    if -180.0 <= value < 0.0:
        return (value + 360.0) % 360.0
    if value == 360.0:
        return 0.0
    raise ValueError(f"the heading {text} is outside 0 to 360 degrees")


def _tilt_deg(text: str, limit_deg: float) -> float:
    if not text:
        return NAN
    value = float(text)
    if -limit_deg <= value <= limit_deg:
        return value
    raise ValueError(f"a pitch or roll of {text} degrees cannot be")

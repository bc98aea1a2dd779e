"""EBIMU-9DOFV3, the IMU: each ASCII line or HEX frame becomes one sample.

The sensor always sends roll, pitch and yaw, and after them the groups it was told to (``<sog1>`` gyro, ``<soa1>``
accelerometer, ``<som1>`` magnetometer). Nothing in a line says which groups they are: the option `groups` names them in
the order in which they come.

ASCII (``<soc1>``, ``<sof1>``): ``*roll,pitch,yaw,gx,gy,gz,ax,ay,az``, in degrees, degrees/s, g and microtesla.

HEX (``<soc2>``): ``55 55``, each value as a big-endian 16-bit integer in two's complement, then the low 16 bits of the
sum of all bytes before, also big-endian. Angles are in 1/100 degree, rates in 1/10 degree/s, accelerations in 1/1000 g.
These agree with the manufacturer's later models; for the magnetic field, which no source at hand states, 1/10
microtesla is assumed. It is recorded and never fused.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Sequence
from math import hypot
from operator import itemgetter, le, truediv

from .framing import HexFraming, LineFraming, frame_sum_is_right
from .sample import IMU, NAN, ImuSample

#: Group -> its first column in a sample, the largest value that can be true, and HEX counts per unit.
_GROUPS = {
    "angles": (0, 360.0, 100.0),
    "gyro": (3, 4000.0, 10.0),
    "accel": (6, 32.0, 1000.0),
    "mag": (9, 5000.0, 10.0),
}
_COLUMNS = 12
#: Norms that no value beyond its limit can be part of.
_PASSES = 360.0
_PASSES_ACCEL = 32.0


class GroupsError(ValueError):
    """The option `groups` does not name the sensor's groups."""


class _EbimuDecoder:
    """What both formats share: the values in order, checked and put into a sample."""

    def __init__(self, groups: str = "gyro,accel") -> None:
        """`groups`: what follows roll, pitch and yaw, of gyro, accel and mag, in order; empty for nothing."""
        self.counts: Counter[str] = Counter()
        self.last_error = ""
        names = ["angles", *(name.strip() for name in groups.split(",") if name.strip())]
        for name in names[1:]:
            if name not in _GROUPS or name == "angles":
                raise GroupsError(f'groups = "{groups}": "{name}" is none of gyro, accel, mag')
        if len(set(names)) < len(names):
            raise GroupsError(f'groups = "{groups}" names a group twice')
        self._limits = tuple(_GROUPS[name][1] for name in names for _ in range(3))
        self._units = tuple(_GROUPS[name][2] for name in names for _ in range(3))
        self._count = 3 * len(names)
        first = 3 * names.index("accel") if "accel" in names else 0
        self._accel = slice(first, first + 3 if first else 0)
        sent = [_GROUPS[name][0] + axis for name in names for axis in range(3)]
        # For each column of a sample, where its value stands in (*values, NAN).
        picks = [sent.index(column) if column in sent else self._count for column in range(_COLUMNS)]
        self._in_order = picks == [*range(self._count), *[self._count] * (_COLUMNS - self._count)]
        self._pick = itemgetter(*picks)

    def _sample(self, t_us: int, values: tuple[float, ...], line: bytes) -> Sequence[ImuSample]:
        # Nearly every line passes the norms, which are quick; both questions are false for NaN and infinity.
        if not (hypot(*values) <= _PASSES and hypot(*values[self._accel]) <= _PASSES_ACCEL) and not all(
            map(le, map(abs, values), self._limits)
        ):
            return self._refuse("malformed", line, "a value cannot be")
        self.counts["samples"] += 1
        if self._in_order:
            return (ImuSample(t_us, IMU, 0, *values),)
        return (ImuSample(t_us, IMU, 0, *self._pick((*values, NAN))),)

    def _refuse(self, reason: str, line: bytes, why: str) -> tuple[()]:
        self.counts[reason] += 1
        self.last_error = f"{reason}: {why}: {line[:82]!r}"
        return ()


class EbimuAsciiDecoder(_EbimuDecoder):
    """Decodes the ASCII lines of an EBIMU.

    Reasons in `counts` for which a line gives nothing: "malformed" (among them any other number of values than
    `groups` promises), "foreign" (an NMEA sentence), "unused" (the sensor's answer to a command, ``<...>``).
    """

    def framing(self) -> LineFraming:
        """A fresh framing for this sensor's port."""
        return LineFraming()

    def decode(self, t_us: int, line: bytes) -> Sequence[ImuSample]:
        """The sample of one line received at `t_us` microseconds; nothing if it is none."""
        self.counts["lines"] += 1
        first = line[:1]
        if first != b"*":
            if first in (b"$", b"!"):
                return self._refuse("foreign", line, "an NMEA sentence on an IMU port")
            if first == b"<":
                self.counts["unused"] += 1
                return ()
            return self._refuse("malformed", line, "a line of the IMU begins with *")
        fields = line[1:].split(b",")
        if len(fields) != self._count:
            return self._refuse("malformed", line, f"{len(fields)} values where {self._count} are expected")
        if b"_" in line:  # which float() would read over
            return self._refuse("malformed", line, "a character that no number has")
        try:
            values = tuple(map(float, fields))
        except ValueError:
            return self._refuse("malformed", line, "a field is no number")
        return self._sample(t_us, values, line)


class EbimuHexDecoder(_EbimuDecoder):
    """Decodes the HEX frames of an EBIMU; a "line" is one frame with its start and its sum.

    Reasons in `counts` for which a frame gives nothing: "malformed" (its length), "checksum", "foreign" (a text line).
    """

    def __init__(self, groups: str = "gyro,accel") -> None:
        """`groups`: as in the ASCII format."""
        super().__init__(groups)
        self._content = struct.Struct(f">2x{self._count}h2x")

    def framing(self) -> HexFraming:
        """A fresh framing for this sensor's port and groups."""
        return HexFraming(self._content.size)

    def decode(self, t_us: int, line: bytes) -> Sequence[ImuSample]:
        """The sample of one frame received at `t_us` microseconds; nothing if it is none."""
        self.counts["lines"] += 1
        if line[:2] != HexFraming.START:
            if line[:1] in (b"$", b"!", b"*"):
                return self._refuse("foreign", line, "a text line where HEX frames are expected")
            return self._refuse("malformed", line, "a frame begins with 55 55")
        if len(line) != self._content.size:
            return self._refuse("malformed", line, f"{len(line)} bytes where {self._content.size} are expected")
        if not frame_sum_is_right(line):
            return self._refuse("checksum", line, "the sum of the frame is wrong")
        return self._sample(t_us, tuple(map(truediv, self._content.unpack(line), self._units)), line)

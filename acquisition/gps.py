"""GPS: the sentences of one UTC time become one sample.

A receiver speaks in bursts, one for each epoch, and says in none of them which sentence is the last. The decoder
learns it: an epoch is complete with the kind of sentence that ended the last one, so that its sample is not kept
waiting for the next burst; until that is known, and whenever that sentence is lost, the next UTC time closes it.
Two epochs in a row have to end with another kind before that kind is waited for, so neither a lost line nor a sentence
that comes every fifth epoch changes the rhythm.

GGA, RMC, GNS and GLL carry the time. VTG and GSA do not: they belong to the open epoch, unless a pause of the line
shows that they already begin the next burst. A sentence that can add nothing (VTG beside RMC, GLL beside GGA or RMC) is
passed over, and nothing waits for it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

from .framing import LineFraming
from .gps_sentences import (
    DAY_S,
    Reading,
    read_gga,
    read_gll,
    read_gns,
    read_gsa,
    read_rmc,
    read_vtg,
    read_zda,
)
from .nmea import SentenceError, read_sentence
from .sample import NAN, GpsSample

_READERS: dict[str, Callable[[list[str]], Reading]] = {
    "GGA": read_gga,
    "RMC": read_rmc,
    "GNS": read_gns,
    "GLL": read_gll,
}
_OTHER_DEVICES = frozenset({"HDM", "HDG", "HDT", "THS", "XDR"})

#: So many epochs in a row, each later than the one before, make a clock that stepped back believed again.
_EPOCHS_TO_BELIEVE = 3
#: A silence longer than this part of the epoch's period separates two bursts.
_PAUSE = 0.6
_CACHED_SENTENCES = 64
_MOST_EARLY = 8

#: What a sentence without a time adds to its epoch: GSA an HDOP, VTG a speed in m/s and a course in degrees.
_Untimed = float | tuple[float, float]


#: Times that differ less are one UTC time: some receivers round it to 1/100 s in one sentence and not in another.
_SAME_TIME_S = 0.0055


def _same_time(a_s: float | None, b_s: float | None) -> bool:
    return a_s == b_s or (a_s is not None and b_s is not None and abs(a_s - b_s) < _SAME_TIME_S)


class _Epoch:
    """The sentences of one UTC time, as far as they have come."""

    __slots__ = ("closed", "first_kind", "hdop", "last_kind", "opened_us", "raw", "readings", "tod_s", "vtg")

    def __init__(self, opened_us: int, kind: str, tod_s: float | None) -> None:
        self.opened_us = opened_us
        self.tod_s = tod_s
        self.first_kind = kind
        self.last_kind = kind
        self.closed = False
        self.readings: dict[str, Reading] = {}
        self.vtg: tuple[float, float] | None = None
        self.hdop = NAN
        self.raw: dict[str, list[str]] = {}  # fields as received, to recognise a repeated epoch


class GpsDecoder:
    """Decodes the lines of one NMEA 0183 receiver.

    A void epoch (no fix) is a sample too, with fix quality 0 and no position: the receiver lives. Reasons in `counts`
    for which a line or an epoch gives nothing: "checksum", "malformed", "foreign" (another kind of device speaks),
    "unused" (a sentence, or a part of one, that this decoder does not need), "backwards", "repeated".
    """

    def __init__(self, source: int, *, checksum: bool = True) -> None:
        """`source`: 0 to 7, the number in the samples; `checksum`: whether a sentence needs a right one."""
        self.counts: Counter[str] = Counter()
        self.last_error = ""
        self._source = source
        self._checksum = checksum
        self._epoch: _Epoch | None = None
        self._accepted: _Epoch | None = None  # the last epoch that became a sample
        self._closer = ""
        self._candidate = ""
        self._line_us = 0
        self._period_us = 0
        self._between = False  # a pause, and no sentence with a time since
        self._early: list[tuple[str, list[str], _Untimed]] = []  # untimed sentences ahead of their epoch
        self._cache: dict[bytes, tuple[str, list[str]]] = {}
        self._dated = False
        self._reference_s: float | None = None  # the last UTC known, in seconds since 1970, or since some midnight
        self._accepted_s: float | None = None
        self._backward_s = 0.0
        self._backward_run = 0

    def framing(self) -> LineFraming:
        """A fresh framing for this receiver's port."""
        return LineFraming()

    def decode(self, t_us: int, line: bytes) -> Sequence[GpsSample]:
        """The samples of the epochs that `line`, received at `t_us` microseconds, closes: none, one or two."""
        counts = self.counts
        counts["lines"] += 1
        pause_us = t_us - self._line_us
        self._line_us = t_us
        if 0 < self._period_us * _PAUSE < pause_us:
            self._between = True
            self._early.clear()
        try:
            cached = self._cache.get(line)
            kind, fields = cached if cached is not None else self._read(line)
            read = _READERS.get(kind)
            if read is not None:
                samples = self._timed(t_us, kind, fields, read(fields))
            elif kind in ("GSA", "VTG"):
                value = read_gsa(fields) if kind == "GSA" else read_vtg(fields)
                if self._between:
                    if len(self._early) < _MOST_EARLY:
                        self._early.append((kind, fields, value))
                    return ()
                samples = self._untimed(t_us, kind, fields, value)
            elif kind == "ZDA":
                self._learn_date(*read_zda(fields))
                return ()
            elif kind in _OTHER_DEVICES:
                return self._refuse("foreign", line, f"{kind} comes from a compass")
            else:
                counts["unused"] += 1
                return ()
        except SentenceError as error:
            return self._refuse(error.reason, line, str(error))
        except ValueError as error:
            return self._refuse("malformed", line, str(error))
        counts["samples"] += len(samples)
        return samples

    def _read(self, line: bytes) -> tuple[str, list[str]]:
        first = line[:1]
        if first in (b"!", b"*"):
            raise SentenceError("foreign", "AIS, or an IMU, speaks on a GPS port")
        kind, fields = read_sentence(line, self._checksum, self.counts)
        if kind == "GSA":  # the same to the letter for many epochs
            if len(self._cache) >= _CACHED_SENTENCES:
                self._cache.clear()
            self._cache[line] = kind, fields
        return kind, fields

    def _refuse(self, reason: str, line: bytes, why: str) -> tuple[()]:
        self.counts[reason] += 1
        self.last_error = f"{reason}: {why}: {line[:82]!r}"
        return ()

    # -- epochs: which sentence belongs to which

    def _timed(self, t_us: int, kind: str, fields: list[str], reading: Reading) -> list[GpsSample]:
        self._between = False
        epoch = self._epoch
        samples: list[GpsSample] = []
        if epoch is None or not _same_time(reading.tod_s, epoch.tod_s) or self._begins_again(epoch, kind, reading):
            samples = self._turn(t_us)
            epoch = self._open(t_us, kind, reading.tod_s)
        elif kind == "GLL" and ("GGA" in epoch.readings or "RMC" in epoch.readings):
            return samples
        elif kind in epoch.readings:
            if kind == epoch.first_kind and epoch.raw[kind] == fields:
                self.counts["repeated"] += 1
            return samples
        if not epoch.closed:
            epoch.readings[kind] = reading
            epoch.raw[kind] = fields
        epoch.last_kind = kind
        if kind == self._closer and not epoch.closed:
            samples += self._close(epoch, t_us)
        return samples

    def _begins_again(self, epoch: _Epoch, kind: str, reading: Reading) -> bool:
        """Whether a sentence of the epoch's own UTC time is nevertheless the first of another epoch."""
        first = epoch.readings.get(kind)
        if first is None:
            return False
        return epoch.closed or reading.tod_s is None or reading.says_more_or_other_than(first)

    def _open(self, t_us: int, kind: str, tod_s: float | None) -> _Epoch:
        previous = self._epoch
        if previous is not None and t_us > previous.opened_us:
            self._period_us = t_us - previous.opened_us
        epoch = self._epoch = _Epoch(t_us, kind, tod_s)
        if self._early:
            for early in self._early:
                self._add(epoch, *early)
            self._early.clear()
        return epoch

    def _untimed(self, t_us: int, kind: str, fields: list[str], value: _Untimed) -> list[GpsSample]:
        epoch = self._epoch
        if epoch is None or (kind == "VTG" and "RMC" in epoch.readings):
            return []
        epoch.last_kind = kind
        if epoch.closed:
            return []
        self._add(epoch, kind, fields, value)
        return self._close(epoch, t_us) if kind == self._closer else []

    def _add(self, epoch: _Epoch, kind: str, fields: list[str], value: _Untimed) -> None:
        if isinstance(value, float):
            if epoch.hdop != epoch.hdop:
                epoch.hdop = value
                epoch.raw[kind] = fields
        elif epoch.vtg is None:
            epoch.vtg = value
            epoch.raw[kind] = fields

    def _turn(self, t_us: int) -> list[GpsSample]:
        """The next epoch begins: close the open one if nothing has, and learn which kind of sentence ended it."""
        epoch = self._epoch
        if epoch is None:
            return []
        samples = [] if epoch.closed else self._close(epoch, t_us)
        last = epoch.last_kind
        if last == self._closer:
            self._candidate = ""
        elif not self._closer or last == self._candidate:
            self._closer = last
            self._candidate = ""
        else:
            self._candidate = last
        return samples

    # -- time: the date, and epochs that go back or repeat

    def _learn_date(self, tod_s: float | None, day_s: float) -> None:
        if tod_s is not None and day_s == day_s:
            self._set_dated()
            self._reference_s = day_s + tod_s

    def _set_dated(self) -> None:
        if not self._dated:
            self._dated = True
            self._accepted_s = None  # it was counted from an unknown midnight

    def _utc_s(self, tod_s: float, day_s: float) -> float:
        """Seconds since 1970 (while no date is known: since the first midnight) of a time of day near the last one."""
        if day_s == day_s:
            self._set_dated()
            return day_s + tod_s
        reference_s = self._reference_s
        if reference_s is None:
            return tod_s
        utc_s = reference_s // DAY_S * DAY_S + tod_s
        if utc_s < reference_s - DAY_S / 2:
            return utc_s + DAY_S
        if utc_s > reference_s + DAY_S / 2:
            return utc_s - DAY_S
        return utc_s

    def _is_in_order(self, epoch: _Epoch, utc_s: float) -> bool:
        """Whether the epoch follows the last one accepted; counts it where it goes back, or repeats it."""
        accepted_s = self._accepted_s
        if accepted_s is not None and utc_s <= accepted_s:
            if utc_s < accepted_s:
                self._backward_run = self._backward_run + 1 if self._backward_run and utc_s > self._backward_s else 1
                self._backward_s = utc_s
                if self._backward_run < _EPOCHS_TO_BELIEVE:
                    self.counts["backwards"] += 1
                    self.last_error = f"backwards: an epoch {accepted_s - utc_s:.3f} s before the last one"
                    return False
            elif self._accepted is not None:
                raw = self._accepted.raw
                if all(raw.get(kind) == fields for kind, fields in epoch.raw.items()):
                    self.counts["repeated"] += 1
                    return False
        self._backward_run = 0
        return True

    # -- the sample

    def _close(self, epoch: _Epoch, t_us: int) -> list[GpsSample]:
        epoch.closed = True
        get = epoch.readings.get
        gga, rmc, gns, gll = get("GGA"), get("RMC"), get("GNS"), get("GLL")
        order = [reading for reading in (gga, rmc, gns, gll) if reading is not None]
        tod_s = order[0].tod_s
        utc_s = NAN
        if tod_s is not None:
            utc_s = self._utc_s(tod_s, rmc.day_s if rmc is not None else NAN)
            if not self._is_in_order(epoch, utc_s):
                return []
            self._reference_s = self._accepted_s = utc_s
            self._accepted = epoch
            if not self._dated:
                utc_s = NAN

        quality = next((reading.quality for reading in order if reading.quality >= 0), -1)
        if rmc is not None and rmc.quality == 0:
            quality = 0
        high = gga if gga is not None else gns
        hdop = epoch.hdop
        altitude_m, satellites = NAN, -1
        if high is not None:
            altitude_m, satellites = high.altitude_m, high.satellites
            if hdop != hdop:
                hdop = high.hdop
        variation_deg = rmc.variation_deg if rmc is not None else NAN
        if quality == 0:
            return [
                GpsSample(t_us, self._source, 0, utc_s, hdop=hdop, variation_deg=variation_deg, satellites=satellites)
            ]
        position = next((reading for reading in order if reading.has_position), order[0])
        if rmc is not None:
            speed_mps, course_deg = rmc.speed_mps, rmc.course_deg
        elif epoch.vtg is not None:
            speed_mps, course_deg = epoch.vtg
        else:
            speed_mps = course_deg = NAN
        return [
            GpsSample(
                t_us,
                self._source,
                quality,
                utc_s,
                position.lat_deg,
                position.lon_deg,
                altitude_m,
                speed_mps,
                course_deg,
                hdop,
                variation_deg,
                satellites,
            )
        ]

"""What each sensor last said, beside the fused heading: the rest of the view state, live and in a replay.

Speed, course and satellites are those of one receiver, the best that has a fix, and stay with it until another weighs
more: a navigator can hold them against that receiver's own display. What is silent or stopped is missing.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from acquisition.device import DeviceState
from acquisition.message import CLOSED, SILENT
from acquisition.sample import REFERENCE_TRUE, SAMPLE_SIZE, CompassSample, GpsSample, Sample, unpack
from tinyekf_py.fusion import HeadingFusion
from tinyekf_py.view_state import MAX_SENSOR_AGE_S, NAN, Navigation, SensorRow

#: Slower over ground, a course says nothing of the boat.
LEAST_SPEED_MPS = 0.5
#: What people are told of a port whose state has another name in messages.
_PORT_WORDS = {SILENT: "stale", CLOSED: "starting"}


class _Tilt(NamedTuple):
    t_us: int
    roll_deg: float
    pitch_deg: float


class Instruments:
    """The last sample of every source of one fusion."""

    def __init__(self, fusion: HeadingFusion) -> None:
        self._fusion = fusion
        self._last: dict[str, Sample] = {}
        self._tilt: _Tilt | None = None  # the compass'
        self._best = ""  # the receiver that navigation follows

    def take(self, name: str, records: bytes) -> None:
        """Note packed samples of source `name`, of which the last counts."""
        sample = unpack(records[-SAMPLE_SIZE:])
        self._last[name] = sample
        if isinstance(sample, CompassSample) and math.isfinite(sample.roll_deg + sample.pitch_deg):
            self._tilt = _Tilt(sample.t_us, sample.roll_deg, sample.pitch_deg)

    def sensor_row(self, name: str, t_us: int, port_state: str = "open") -> SensorRow:
        """The row of source `name` at a moment, without what only its port knows."""
        sample = self._last.get(name)
        row = SensorRow(name, port_state)
        if sample is None:
            return row
        row = row._replace(age_s=max(0.0, (t_us - sample.t_us) / 1e6))
        if isinstance(sample, GpsSample):
            weight = self._fusion.weight_at(t_us, sample.source)
            row = row._replace(fix_quality=sample.fix_quality, hdop=sample.hdop, weight=weight)
            course_deg = _course_deg(sample) if weight > 0.0 else NAN
            if math.isfinite(course_deg):
                sigma_deg = self._fusion.course_sigma_deg(sample.speed_mps, sample.hdop, weight)
                row = row._replace(heading_deg=course_deg, heading_sigma_deg=sigma_deg)
        elif isinstance(sample, CompassSample):
            heading_deg = self._fusion.compass_deg_at(t_us)
            if math.isfinite(heading_deg):
                row = row._replace(heading_deg=heading_deg, heading_sigma_deg=self._fusion.compass_sigma_deg)
        return row

    def device_row(self, state: DeviceState, t_us: int) -> SensorRow:
        """The row of a live device at a moment."""
        port_state = _PORT_WORDS.get(state.port_state, state.port_state) if state.polling else "stopped"
        return self.sensor_row(state.name, t_us, port_state)._replace(
            rate_hz=state.rate_hz,
            errors=state.errors,
            last_error=state.last_error,
            port_text=state.port_text,
            restarts=state.restarts,
            lines=state.counts["lines"],
            samples=state.counts["samples"],
            down_s=state.counts["down_ms"] / 1000,
            dropped=tuple(state.dropped.items()),
        )

    def navigation(self, t_us: int, estimate_us: int | None) -> Navigation:
        """What a navigator is told at a moment; UTC is that of the estimate made for `estimate_us`."""
        gps = self._best_receiver(t_us)
        variation_deg, deviation_deg = self._magnetism(t_us)
        roll_deg, pitch_deg = self._fusion.attitude_deg_at(t_us)
        if math.isnan(roll_deg) and self._tilt is not None and t_us - self._tilt.t_us <= MAX_SENSOR_AGE_S * 1e6:
            _, roll_deg, pitch_deg = self._tilt
        fixed = Navigation(
            utc_s=self._utc_s(estimate_us),
            roll_deg=roll_deg,
            pitch_deg=pitch_deg,
            variation_deg=variation_deg,
            deviation_deg=deviation_deg,
        )
        if gps is None:
            return fixed
        return fixed._replace(
            sog_mps=gps.speed_mps,
            cog_deg=_course_deg(gps),
            altitude_m=gps.altitude_m,
            fix_quality=gps.fix_quality,
            satellites=gps.satellites,
            hdop=gps.hdop,
        )

    def _best_receiver(self, t_us: int) -> GpsSample | None:
        weights = {
            name: weight
            for name, sample in self._last.items()
            if isinstance(sample, GpsSample)
            and sample.fix_quality >= 1
            and t_us - sample.t_us <= MAX_SENSOR_AGE_S * 1e6
            and math.isfinite(weight := self._fusion.weight_at(t_us, sample.source))
        }
        if not weights:
            return None
        if not weights.get(self._best, -1.0) >= max(weights.values()):
            self._best = max(sorted(weights), key=lambda name: weights[name])
        best = self._last[self._best]
        assert isinstance(best, GpsSample)
        return best

    def _utc_s(self, estimate_us: int | None) -> float:
        """By the receiver that navigation follows, else whichever spoke last; carried on by our clock in a silence."""
        if estimate_us is None:
            return NAN
        dated = {
            name: sample
            for name, sample in self._last.items()
            if isinstance(sample, GpsSample) and math.isfinite(sample.utc_s)
        }
        newest = dated.get(self._best) or max(dated.values(), key=lambda sample: sample.t_us, default=None)
        return newest.utc_s + (estimate_us - newest.t_us) / 1e6 if newest is not None else NAN

    def _magnetism(self, t_us: int) -> tuple[float, float]:
        """Variation in use, and the deviation applied to the compass' last heading."""
        compass = self._last.get("compass")
        heading_deg = self._fusion.compass_deg_at(t_us)
        if not isinstance(compass, CompassSample) or compass.reference == REFERENCE_TRUE or math.isnan(heading_deg):
            return self._fusion.variation_deg(), NAN
        variation_deg = self._fusion.variation_deg(compass.variation_deg)
        return variation_deg, (heading_deg - compass.heading_deg - variation_deg + 180.0) % 360.0 - 180.0


def _course_deg(gps: GpsSample) -> float:
    """Its course over ground; NaN when the boat is too slow for it to mean anything."""
    return gps.course_deg if gps.speed_mps >= LEAST_SPEED_MPS else NAN

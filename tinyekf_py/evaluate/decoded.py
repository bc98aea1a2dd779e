"""A recording, decoded once for all the methods that are to run on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquisition.recording import Event, read_recording
from acquisition.sample import COMPASS, IMU, MAX_GPS, REFERENCE_TRUE, SOURCES
from tinyekf_py.config import Config
from tinyekf_py.deviation import deviation_deg
from tinyekf_py.evaluate.truth import Floats
from tinyekf_py.fusion import rotation
from tinyekf_py.replay import Replay
from tinyekf_py.sample_array import sample_dtype
from tinyekf_py.sensor_config import CompassConfig, ImuConfig
from tinyekf_py.variation import VariationError, variation_deg

ROW_S = 0.1


@dataclass(frozen=True)
class Decoded:
    """What a recording holds: packed samples and the task switches between them, and the boat's configuration."""

    config: Config
    parts: tuple[bytes | Event, ...]

    @cached_property
    def samples(self) -> NDArray[np.void]:
        """All samples in order, but those of sources that were stopped: an array of `sample_array.sample_dtype`."""
        stopped: set[int] = set()
        chunks = []
        for part in self.parts:
            if isinstance(part, Event):
                number = SOURCES.get(part.name, -1)
                if part.verb == "stop":
                    stopped.add(number)
                elif part.verb == "start":
                    stopped.discard(number)
            else:
                chunk = np.frombuffer(part, sample_dtype)
                chunks.append(chunk[~np.isin(chunk["source"], list(stopped))] if stopped else chunk)
        return np.concatenate(chunks) if chunks else np.empty(0, sample_dtype)

    @cached_property
    def rows_s(self) -> Floats:
        """The 100 ms grid from the first to the last sample, seconds: the rows that fusion writes."""
        if not len(self.samples):
            return np.empty(0)
        first, last = int(self.samples["t_us"][0]), int(np.max(self.samples["t_us"]))
        return np.arange(-(-first // 100_000), -(-last // 100_000)).astype(np.float64) * ROW_S

    @cached_property
    def first_fix_s(self) -> float:
        """When the first GPS position came, seconds; NaN without one."""
        fixes = self._fixes
        return float(fixes["t_us"][0]) / 1e6 if len(fixes) else np.nan

    def of_gps(self, number: int) -> NDArray[np.void]:
        """The samples of receiver `number` (1 for gps1)."""
        chosen: NDArray[np.void] = self.samples[self.samples["source"] == number - 1]
        return chosen

    @property
    def gps_numbers(self) -> tuple[int, ...]:
        """Numbers of the receivers aboard, from 1."""
        return tuple(SOURCES[name] + 1 for name in self.config.sources if SOURCES[name] < MAX_GPS)

    @cached_property
    def imu(self) -> tuple[Floats, Floats, Floats]:
        """Of each complete IMU sample: seconds (n,); gyro, degrees/s (n, 3); gravity, g (n, 3): in the boat's axes.

        The configured bias is taken off the gyro.
        """
        samples = self.samples[self.samples["source"] == IMU]
        samples = samples[np.all(np.isfinite(samples["gyro_dps"]), axis=1)]
        sensor = self.config.sensors.get("imu")
        turn, sign, bias_dps = np.eye(3), 1.0, np.zeros(3)
        if isinstance(sensor, ImuConfig):
            turn = np.array(rotation(sensor.mount))
            bias_dps = np.array(sensor.gyro_bias_dps)
            sign = -1.0 if sensor.accel == "specific-force" else 1.0
        return samples["t_us"] / 1e6, (samples["gyro_dps"] - bias_dps) @ turn.T, sign * samples["accel_g"] @ turn.T

    @cached_property
    def compass(self) -> tuple[Floats, Floats, Floats]:
        """Of each compass sample: seconds; heading as the compass shows it; true heading (degrees, NaN if unknown)."""
        samples = self.samples[self.samples["source"] == COMPASS]
        sensor = self.config.sensors.get("compass")
        terms = sensor.deviation if isinstance(sensor, CompassConfig) else (0.0,) * 5
        shown = samples["heading_deg"]
        own = samples["deviation_deg"]
        magnetic = shown + np.where(np.isfinite(own), own, deviation_deg(terms, shown))
        variation = np.full(len(samples), self.variation_deg)
        variation = np.where(np.isfinite(variation), variation, samples["variation_deg"])
        true = np.where(samples["code"] == REFERENCE_TRUE, shown, magnetic + variation) % 360.0
        return samples["t_us"] / 1e6, shown, true

    @property
    def compass_reference(self) -> NDArray[np.int32]:
        """Of each compass sample: what its heading refers to (`sample.REFERENCE_COMPASS`, `REFERENCE_TRUE`)."""
        reference: NDArray[np.int32] = self.samples["code"][self.samples["source"] == COMPASS]
        return reference

    @cached_property
    def variation_deg(self) -> float:
        """Magnetic variation, east positive: the configured, else the World Magnetic Model's, else the receivers'."""
        configured = self.config.vessel.variation_deg
        if not isinstance(configured, str):
            return configured
        dated = self._fixes[np.isfinite(self._fixes["utc_s"])]
        if len(dated):
            when = datetime.fromtimestamp(float(dated["utc_s"][0]), UTC).date()
            try:
                return variation_deg(float(dated["lat_deg"][0]), float(dated["lon_deg"][0]), when)
            except VariationError:
                pass  # without the model the sentences must do
        said = self._fixes["gps_variation_deg"]
        said = said[np.isfinite(said)]
        return float(said[0]) if len(said) else np.nan

    @cached_property
    def _fixes(self) -> NDArray[np.void]:
        samples = self.samples
        is_fix = (samples["source"] < MAX_GPS) & (samples["code"] >= 1)
        fixes: NDArray[np.void] = samples[is_fix & np.isfinite(samples["lat_deg"]) & np.isfinite(samples["lon_deg"])]
        return fixes


def decode(paths: str | Path | Sequence[str | Path], config: Config | None = None) -> Decoded:
    """Decode a recording (its pieces); `config` replaces the recording's own."""
    replay = Replay(read_recording(paths), config=config)
    return Decoded(replay.config, tuple(replay.parts()))


def held(t_s: Floats, values: Any, rows_s: Floats, max_age_s: float) -> Any:
    """At each row the latest of `values` (shape (n,) or (n, k), taken at `t_s`); NaN where it is older than that."""
    if not len(t_s):
        return np.full((len(rows_s), *np.shape(values)[1:]), np.nan)
    latest = np.searchsorted(t_s, rows_s, side="right") - 1
    fresh = (latest >= 0) & (rows_s - t_s[np.maximum(latest, 0)] <= max_age_s)
    result = np.asarray(values, float)[np.maximum(latest, 0)]
    result[~fresh] = np.nan
    return result

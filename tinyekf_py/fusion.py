"""HeadingFusion: samples in, one heading out; the Python face of the C core's whole pipeline (`csrc/fusion.h`).

The live program, the replay and a notebook all feed the same object: what a live run wrote, its replay writes again.
`docs/fusion.md` says what it computes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from acquisition.recording import Event
from acquisition.sample import COMPASS, IMU, MAX_GPS, SAMPLE_SIZE, SOURCES, Sample
from tinyekf_py._core import ffi, lib
from tinyekf_py.config import PAPER_Q, PAPER_R, Config
from tinyekf_py.estimate import Estimate
from tinyekf_py.fusion_config import AdaptiveConfig
from tinyekf_py.sensor_config import CompassConfig, ImuConfig
from tinyekf_py.variation import VariationError, variation_deg

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

METHODS = {
    "cnw-ekf": lib.FUSION_CNW_EKF,
    "cnw3": lib.FUSION_CNW3,
    "ekf-ci": lib.FUSION_EKF_CI,
    "adaptive": lib.FUSION_ADAPTIVE,
}

#: Every task that can be started and stopped: the polls are named as their sources, then the stages and filters.
STAGES = {
    "cnw-s1": lib.FUSION_STAGE1,
    "cnw-s2": lib.FUSION_STAGE2,
    "cnw-s3": lib.FUSION_STAGE3,
    **{f"ekf{i + 1}": lib.FUSION_EKF1 + i for i in range(MAX_GPS)},
}

_MODES = {
    lib.FUSION_OK: "ok",
    lib.FUSION_DEGRADED: "degraded",
    lib.FUSION_DEAD_RECKONING: "dead-reckoning",
    lib.FUSION_GPS: "gps",
    lib.FUSION_INVALID: "invalid",
}
_ADAPTIVE = AdaptiveConfig()
_NEVER = -(2**63)  # SOURCE_NEVER
_ROWS = 1024  # taken from C at a time
#: Verdict -> from how many samples on it is worth telling (the first fix brings the variation), and what is told.
_REFUSALS = {
    lib.FUSION_NO_VARIATION: (20, "compass not used: the magnetic variation is unknown; set vessel.variation_deg"),
    lib.FUSION_BACKWARDS: (1, "samples dropped: their time runs backwards"),
    lib.FUSION_STUCK: (1, "compass or IMU not used while it sticks at one value"),
}


class HeadingFusion:
    """Fuses samples of GPS receivers, compass and IMU to one true heading with its standard deviation.

    A pure function of its options and the sequence of samples and task switches. Not thread-safe.
    """

    def __init__(
        self,
        method: str = "adaptive",
        *,
        n_gps: int | None = None,
        sources: Sequence[str] = ("gps1", "gps2", "gps3", "compass", "imu"),
        variation_deg: float | str = "auto",
        deviation_deg: Sequence[float] = (0.0, 0.0, 0.0, 0.0, 0.0),
        mount_deg: Sequence[float] = (0.0, 0.0, 0.0),
        accel: str = "gravity",
        max_sigma_deg: float = 30.0,
        ekf_gps: int = 1,
        q: Sequence[float] = PAPER_Q,
        r: Sequence[float] = PAPER_R,
        latency_ms: Mapping[str, float] | None = None,
        gyro_bias_dps: Sequence[float] = (0.0, 0.0, 0.0),
        antennas_m: Sequence[Sequence[float]] = (),
        adaptive: AdaptiveConfig = _ADAPTIVE,
    ) -> None:
        """`sources` are the sensors aboard; `n_gps` = N is short for gps1 to gpsN in their place.

        `variation_deg`: degrees, east positive, or "auto" (World Magnetic Model, else the sentences').
        `deviation_deg`: A to E of the compass. `mount_deg`: roll, pitch, yaw of the rotation that turns the IMU's
        axes into the boat's. `accel`: "gravity" or "specific-force". `ekf_gps`: whose filter `cnw-ekf` runs.
        `latency_ms`: by source, from the moment measured to the stamp, where it is not the usual (`adaptive` alone).
        `gyro_bias_dps`: taken off the gyro's readings, about its own x, y and z. `antennas_m`: [ahead, to starboard] of
        gps1, gps2, ... against the boat's reference point, and `adaptive`: what that method, the only one that uses
        both, believes beforehand.
        `q` (per second), `r`: noise of the papers' filters, [north m^2, east m^2, heading degrees^2].
        ValueError for what is unknown or out of range.
        """
        if method not in METHODS:
            raise ValueError(f"method {method!r}; there are {', '.join(METHODS)}")
        if n_gps is not None:
            sources = [*(f"gps{i + 1}" for i in range(n_gps)), *(s for s in sources if not s.startswith("gps"))]
        unknown = [source for source in sources if source not in SOURCES]
        if unknown:
            raise ValueError(f"source {unknown[0]!r}; there are {', '.join(SOURCES)}")
        numbers = {SOURCES[source] for source in sources}
        gps = {number for number in numbers if number < MAX_GPS}
        if accel not in ("gravity", "specific-force"):
            raise ValueError(f"accel {accel!r}; there are gravity and specific-force")
        if isinstance(variation_deg, str) and variation_deg != "auto":
            raise ValueError(f"variation_deg {variation_deg!r}; give degrees or 'auto'")

        settings = ffi.new("fusion_settings_t *", lib.fusion_default_settings)
        settings.method = METHODS[method]
        settings.n_gps = max(gps, default=-1) + 1
        settings.absent_gps = sum(1 << i for i in range(settings.n_gps) if i not in gps)
        settings.has_compass = COMPASS in numbers
        settings.has_imu = IMU in numbers
        settings.ekf_gps = ekf_gps - 1
        for noise, values, papers in ((settings.noise.q, q, PAPER_Q), (settings.noise.r, r, PAPER_R)):
            if tuple(values) != papers:  # theirs are there already, to the last bit
                noise[0], noise[1], noise[2] = values[0], values[1], values[2] * math.radians(1.0) ** 2
        settings.deviation = [math.radians(term) for term in deviation_deg]
        settings.variation = math.nan if isinstance(variation_deg, str) else math.radians(variation_deg)
        settings.wants_variation = isinstance(variation_deg, str) and COMPASS in numbers
        settings.mount = rotation(mount_deg)
        settings.specific_force = accel == "specific-force"
        settings.max_sigma = math.radians(max_sigma_deg)
        for source, latency in (latency_ms or {}).items():
            settings.adaptive.latency_s[SOURCES[source]] = latency * 1e-3
        settings.gyro_bias = list(gyro_bias_dps)
        for arm, antenna_m in zip(settings.adaptive.arm, antennas_m, strict=False):
            arm[0], arm[1] = antenna_m
        settings.adaptive.current_chance = adaptive.current_chance
        settings.adaptive.unmodelled = math.radians(adaptive.leeway_deg)
        settings.adaptive.noise.current[lib.ADAPTIVE_CURRENTED] = adaptive.current_mps
        settings.adaptive.noise.deviation = [math.radians(sigma) for sigma in adaptive.deviation_sigma_deg]
        self._fusion = ffi.new("fusion_t *")
        if lib.fusion_init(self._fusion, settings) != lib.EKF_ACCEPTED:
            raise ValueError("a number among the fusion's options is not finite or out of range")
        self.method = method
        self.n_gps = int(self._fusion.settings.n_gps)
        self._rows = ffi.new("estimate_t[]", _ROWS)
        self._n_rows = ffi.new("int *")
        self._notices: list[str] = []
        self._told: set[str] = set()

    def feed(self, sample: Sample) -> Estimate | None:
        """Take one sample; the estimate at its moment, None while there is no heading.

        The rows of the 100 ms grid are `feed_records`' and `run`'s affair.
        """
        self.feed_records(sample.pack())
        estimate = self.estimate
        return None if estimate is None or estimate.mode == "invalid" else estimate

    def feed_records(self, records: bytes) -> list[Estimate]:
        """Take packed samples (a multiple of 112 bytes) in order; the grid rows that they completed, oldest first."""
        return [self._estimate_of(row) for chunk, n in self._run(records) for row in chunk[0:n]]

    def run(self, samples: NDArray[np.void] | bytes) -> NDArray[np.void]:
        """Take many samples (packed, or an array of `sample_array.sample_dtype`); their grid rows as an array.

        Its columns are those of the heading CSV (`estimate_array.estimate_dtype`).
        """
        from tinyekf_py.estimate_array import estimates_to_array  # NumPy is dear to start, and the live run needs none

        records = samples if isinstance(samples, bytes) else samples.tobytes()
        return estimates_to_array(self.feed_records(records), self.n_gps)

    def consume(self, records: bytes) -> int:
        """Take packed samples as `feed_records` does and make nothing of their rows but their number.

        What is left is the C core's own time.
        """
        return sum(n for _, n in self._run(records))

    def set_task(self, t_us: int, name: str, running: bool) -> list[Estimate]:
        """Start or stop a task (a source's poll, cnw-s1 to -s3, ekf1 to ekf8) at `t_us`; the rows due before it.

        ValueError when there is no such task.
        """
        if name not in STAGES and name not in SOURCES:
            raise ValueError(f"task {name!r}; there are {', '.join((*SOURCES, *STAGES))}")
        rows = self._rows_before(t_us)
        if name in STAGES:
            lib.fusion_set_task(self._fusion, STAGES[name], running)
        else:
            lib.fusion_set_poll(self._fusion, SOURCES[name], running)
        return rows

    def lose(self, t_us: int, source: str) -> list[Estimate]:
        """Take a source for gone from `t_us` until its next sample: its port hung up. The rows due before it."""
        rows = self._rows_before(t_us)
        lib.fusion_lose(self._fusion, SOURCES[source])
        return rows

    def obey(self, event: Event) -> list[Estimate]:
        """Do what an event of a recording says (start or stop a task, lose a source); the rows due before it."""
        if event.verb == "lost":
            return self.lose(event.t_us, event.name)
        return self.set_task(event.t_us, event.name, event.verb == "start")

    def _rows_before(self, t_us: int) -> list[Estimate]:
        rows = []
        while lib.fusion_next_row(self._fusion, t_us, self._rows):
            rows.append(self._estimate_of(self._rows[0]))
        return rows

    @property
    def estimate(self) -> Estimate | None:
        """The estimate at the newest sample's moment; None before the first sample."""
        return None if self._fusion.now_us == _NEVER else self.estimate_at(self._fusion.now_us)

    def estimate_at(self, t_us: int) -> Estimate:
        """The estimate at a moment that is not before the newest sample."""
        lib.fusion_estimate(self._fusion, t_us, self._rows)
        return self._estimate_of(self._rows[0])

    def variation_deg(self, own_deg: float = math.nan) -> float:
        """Magnetic variation in use with a compass whose sentence gives `own_deg`, east positive; NaN: unknown.

        The configured one or the World Magnetic Model's, else the sentence's, else what a receiver gave.
        """
        known_deg = (math.degrees(self._fusion.settings.variation), own_deg, math.degrees(self._fusion.gps_variation))
        return next((variation for variation in known_deg if math.isfinite(variation)), math.nan)

    def weight_at(self, t_us: int, gps: int) -> float:
        """Stage-1 weight of receiver `gps` (from 0) at a moment, 0 without a fix; NaN when it has fallen silent."""
        receiver = ffi.addressof(self._fusion.gps[gps])
        fresh = lib.source_clock_is_fresh(ffi.addressof(receiver, "clock"), t_us)
        return float(lib.receiver_weight(receiver, t_us)) if fresh else math.nan

    def compass_deg_at(self, t_us: int) -> float:
        """The compass' last heading, made true, [0, 360); NaN without one or when it has fallen silent."""
        fresh = lib.source_clock_is_fresh(ffi.addressof(self._fusion, "compass_clock"), t_us)
        return math.degrees(self._fusion.compass) % 360.0 % 360.0 if fresh else math.nan

    def attitude_deg_at(self, t_us: int) -> tuple[float, float]:
        """Roll (starboard down) and pitch (bow up) by gyro and gravity; NaN without an IMU that speaks and has both."""
        attitude = self._fusion.attitude
        fresh = lib.source_clock_is_fresh(ffi.addressof(self._fusion, "imu_clock"), t_us)
        if not fresh or not attitude.levelled:
            return math.nan, math.nan
        return math.degrees(attitude.roll), math.degrees(attitude.pitch)

    def course_sigma_deg(self, speed_mps: float, hdop: float, weight: float) -> float:
        """Standard deviation of a receiver's course taken for the heading, as method adaptive weighs it.

        By its velocity's noise and by the current that there may be, at a speed over ground; NaN at weight 0.
        """
        noise = self._fusion.settings.adaptive.noise
        if not (weight > 0.0 and speed_mps > 0.0):
            return math.nan
        velocity = noise.velocity * (max(hdop, 0.6) if math.isfinite(hdop) else 2.0) * math.sqrt(3.0 / weight)
        return math.degrees(math.atan(math.hypot(velocity, noise.current[lib.ADAPTIVE_CURRENTED]) / speed_mps))

    @property
    def compass_sigma_deg(self) -> float:
        """Standard deviation of the corrected compass, as method adaptive weighs it before it has learned anything."""
        noise = self._fusion.settings.adaptive.noise
        a, b, c, d, e = noise.deviation
        return math.degrees(math.sqrt(noise.compass**2 + a * a + (b * b + c * c + d * d + e * e) / 2.0))

    @property
    def mean_nis(self) -> float:
        """Mean normalised innovation squared of the headings taken so far, 1 when the filters' noise is honest.

        Of all the papers' filters, or of adaptive's compass readings and courses: its noise holds what errors have in
        common from one reading to the next, so its mean is well below 1. NaN before the first.
        """
        return float(lib.fusion_mean_nis(self._fusion))

    @property
    def verdicts(self) -> dict[str, int]:
        """How many samples were taken, and not taken, by reason."""
        names = ("taken", "stopped", "unknown-source", "backwards", "incomplete", "no-variation", "stuck")
        return dict(zip(names, self._fusion.verdicts, strict=True))

    def take_notices(self) -> list[str]:
        """What a user should know and has not been told yet, a line each."""
        for verdict, (least, text) in _REFUSALS.items():
            if self._fusion.verdicts[verdict] >= least:
                self._notice(text)
        notices, self._notices = self._notices, []
        return notices

    def _notice(self, text: str) -> None:
        if text not in self._told:
            self._told.add(text)
            self._notices.append(text)

    def _run(self, records: bytes) -> Any:
        """Feed records; yields (rows, how many) as often as the row buffer was filled."""
        samples = ffi.from_buffer("sample_t[]", records)
        n = len(records) // SAMPLE_SIZE
        if n * SAMPLE_SIZE != len(records):
            raise ValueError(f"{len(records)} bytes are no whole number of {SAMPLE_SIZE}-byte samples")
        fed = 0
        while fed < n:
            fed += lib.fusion_run(self._fusion, samples + fed, n - fed, self._rows, _ROWS, self._n_rows)
            if self._n_rows[0]:
                yield self._rows, self._n_rows[0]
            if self._fusion.variation_wanted:
                self._look_up_variation()

    def _look_up_variation(self) -> None:
        fusion = self._fusion
        variation = math.nan
        try:
            when = datetime.fromtimestamp(fusion.variation_utc_s, UTC)
            variation = variation_deg(fusion.variation_lat_deg, fusion.variation_lon_deg, when.date())
        except (VariationError, OverflowError, OSError, ValueError) as error:
            self._notice(str(error))
        lib.fusion_set_variation(fusion, math.radians(variation))

    def _estimate_of(self, row: Any) -> Estimate:
        n = self.n_gps
        return Estimate(
            row.t_us,
            row.heading_deg,
            row.heading_sigma_deg,
            row.rate_of_turn_dps,
            row.lat_deg,
            row.lon_deg,
            _MODES[row.mode],
            _MODES[row.pos_mode],
            tuple(row.weight[0:n]),
            tuple(row.faz_deg[0:n]),
            row.gpsec_deg,
            tuple(row.ekf_deg[0:n]),
        )


def fusion_of(config: Config) -> HeadingFusion:
    """The fusion that a configuration asks for."""
    compass, imu = (config.sensors.get(name) for name in ("compass", "imu"))
    return HeadingFusion(
        config.fusion.method,
        sources=config.sources,
        variation_deg=config.vessel.variation_deg,
        deviation_deg=compass.deviation if isinstance(compass, CompassConfig) else (0.0,) * 5,
        mount_deg=imu.mount if isinstance(imu, ImuConfig) else (0.0,) * 3,
        accel=imu.accel if isinstance(imu, ImuConfig) else "gravity",
        max_sigma_deg=config.fusion.max_sigma_deg,
        ekf_gps=config.fusion.cnw_ekf.gps,
        q=config.fusion.q,
        r=config.fusion.r,
        latency_ms={name: config.sensors[name].latency_ms for name in config.sources},
        gyro_bias_dps=imu.gyro_bias_dps if isinstance(imu, ImuConfig) else (0.0,) * 3,
        antennas_m=config.vessel.antennas_m,
        adaptive=config.fusion.adaptive,
    )


def rotation(mount_deg: Sequence[float]) -> list[list[float]]:
    """Rotation matrix from the IMU's axes to the boat's, by roll about x, then pitch about y, then yaw about z."""
    roll, pitch, yaw = (math.radians(angle) for angle in mount_deg)
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (math.cos, math.sin))
    return [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]

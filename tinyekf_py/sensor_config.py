"""The configuration of the sensors: `[sensors.gps1]` to `[sensors.gps8]`, `[sensors.compass]` and `[sensors.imu]`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from acquisition.decoder import DRIVERS
from acquisition.sample import SOURCES
from tinyekf_py.config_key import boolean, choice, integer, key, nonempty_text, number, numbers, text

_baud = integer(50, 4_000_000)


def _latency(default_ms: float) -> Any:
    doc = "How long after the moment measured its lines arrive; only method adaptive uses it."
    return key(default_ms, doc, number(0, 900), unit="milliseconds", shapes_result=True)


def _checksum() -> Any:
    return key(True, "Whether a sentence without a checksum is dropped.", boolean, shapes_result=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorConfig:
    """What every sensor has."""

    decoder_options: ClassVar[tuple[str, ...]] = ()

    enabled: bool = key(True, "Whether the boat has this sensor and it is used.", boolean, shapes_result=True)
    port: str = key(
        "", "Where it is: a device such as /dev/ttyUSB0, or a URL such as socket://host:port.", nonempty_text
    )
    driver: str
    baud: int
    latency_ms: float


@dataclass(frozen=True, slots=True, kw_only=True)
class GpsConfig(SensorConfig):
    """A GPS receiver."""

    decoder_options: ClassVar[tuple[str, ...]] = ("checksum",)

    driver: str = key("nmea", "What it speaks: nmea is NMEA 0183.", choice(*DRIVERS["gps"]), shapes_result=True)
    baud: int = key(
        9600, "Speed of a serial port; 9600 is u-blox's own, and a receiver's USB port ignores it.", _baud, unit="baud"
    )
    checksum: bool = _checksum()
    latency_ms: float = _latency(120.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class CompassConfig(SensorConfig):
    """The electronic compass."""

    decoder_options: ClassVar[tuple[str, ...]] = ("checksum",)

    driver: str = key("nmea", "What it speaks: nmea is NMEA 0183.", choice(*DRIVERS["compass"]), shapes_result=True)
    baud: int = key(9600, "Speed of a serial port; older NMEA compasses have 4800.", _baud, unit="baud")
    checksum: bool = _checksum()
    deviation: tuple[float, ...] = key(
        (0.0, 0.0, 0.0, 0.0, 0.0),
        "Deviation A + B sin z + C cos z + D sin 2z + E cos 2z at compass heading z, as [A, B, C, D, E].",
        numbers("ABCDE", -180, 180),
        unit="degrees, east positive",
        shapes_result=True,
    )
    latency_ms: float = _latency(50.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuConfig(SensorConfig):
    """The inertial measurement unit."""

    decoder_options: ClassVar[tuple[str, ...]] = ("groups",)

    driver: str = key(
        "ebimu-ascii", "What it speaks: ebimu-ascii or ebimu-hex.", choice(*DRIVERS["imu"]), shapes_result=True
    )
    baud: int = key(115200, "Speed of a serial port.", _baud, unit="baud")
    groups: str = key(
        "gyro,accel", "Which groups follow roll, pitch and yaw: of gyro, accel and mag.", text, shapes_result=True
    )
    mount: tuple[float, ...] = key(
        (0.0, 0.0, 0.0),
        "How the IMU is turned in the boat, a rotation from its axes to the boat's, as [roll, pitch, yaw].",
        numbers(("roll", "pitch", "yaw"), -180, 180),
        unit="degrees",
        shapes_result=True,
    )
    accel: str = key(
        "gravity",
        "What the accelerometer shows at rest and level: gravity is (0, 0, +1) g, specific-force (0, 0, -1) g.",
        choice("gravity", "specific-force"),
        shapes_result=True,
    )
    gyro_bias_dps: tuple[float, ...] = key(
        (0.0, 0.0, 0.0),
        "What the gyro shows at rest about its own axes, taken off its readings; tinyekf calibrate gyro finds it.",
        numbers("xyz", -50, 50),
        unit="degrees/s",
        shapes_result=True,
    )
    latency_ms: float = _latency(0.0)


def default_sensor(name: str) -> SensorConfig:
    """The sensor `name` (of `SOURCES`) as it is unless configured otherwise."""
    if name == "compass":
        return CompassConfig(port="/dev/fjEC")
    if name == "imu":
        return ImuConfig(port="/dev/fjIMU")
    return GpsConfig(port=f"/dev/fjGPS{SOURCES[name] + 1}")

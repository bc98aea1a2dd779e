"""The sample: what a decoder makes of a device's lines and what the fusion is fed.

One fixed-size record of 112 bytes for every kind of sensor, laid out as ``sample_t`` in ``csrc/sample.h`` (a test
holds the two together): the tail of a worker's message, the row of a replayed NumPy array, the argument of the C core.
In Python a sample is a named tuple with the sensor's own units in its field names; ``pack`` gives the record.

Missing is missing: NaN, never 0. A fix quality or a satellite count that no sentence gave is -1.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

NAN = float("nan")

MAX_GPS = 8
COMPASS = 8
IMU = 9

#: Name of a source -> its number in the record. Config, recordings and messages use the names.
SOURCES: dict[str, int] = {**{f"gps{i + 1}": i for i in range(MAX_GPS)}, "compass": COMPASS, "imu": IMU}
SOURCE_NAMES: dict[int, str] = {number: name for name, number in SOURCES.items()}

#: What a compass heading refers to (`CompassSample.reference`).
REFERENCE_COMPASS = 0  # as the instrument reads: deviation and variation are still to be applied (HDM, HDG)
REFERENCE_TRUE = 1  # true already (HDT, THS)

SAMPLE_SIZE = 112
_GPS = struct.Struct("<qii8d i4x 24x")
_COMPASS = struct.Struct("<qii5d 56x")
_IMU = struct.Struct("<qii12d")
_HEAD = struct.Struct("<qi")


class GpsSample(NamedTuple):
    """One epoch of a GPS receiver: what its sentences of one UTC time say together."""

    t_us: int  #: stamp of the sentence that closed the epoch, microseconds since the recording's start
    source: int  #: 0 to 7 for gps1 to gps8
    fix_quality: int = -1  #: as GGA's field 6 (0 none, 1 GPS, 2 DGPS, 4 RTK, 5 float RTK, 6 estimated, ...); -1 unknown
    utc_s: float = NAN  #: seconds since 1970-01-01 UTC; NaN until a date is known
    lat_deg: float = NAN  #: WGS-84, north positive
    lon_deg: float = NAN  #: WGS-84, east positive
    altitude_m: float = NAN  #: above mean sea level
    speed_mps: float = NAN  #: over ground
    course_deg: float = NAN  #: over ground, true, [0, 360)
    hdop: float = NAN
    variation_deg: float = NAN  #: magnetic variation as the receiver gives it, east positive
    satellites: int = -1  #: used in the fix

    def pack(self) -> bytes:
        return _GPS.pack(*self)


class CompassSample(NamedTuple):
    """One reading of a compass; a field that the sentence lacks is NaN."""

    t_us: int
    source: int  #: COMPASS
    reference: int = REFERENCE_COMPASS
    heading_deg: float = NAN  #: [0, 360), of the kind `reference` says
    deviation_deg: float = NAN  #: HDG's own deviation, east positive; replaces the configured table
    variation_deg: float = NAN  #: HDG's own variation, east positive
    pitch_deg: float = NAN  #: bow up positive
    roll_deg: float = NAN  #: starboard down positive

    def pack(self) -> bytes:
        return _COMPASS.pack(*self)


class ImuSample(NamedTuple):
    """One reading of an IMU in its own body axes, before `mount`."""

    t_us: int
    source: int  #: IMU
    reserved: int = 0
    roll_deg: float = NAN  #: the IMU's own attitude: recorded, never fused
    pitch_deg: float = NAN
    yaw_deg: float = NAN
    gyro_x_dps: float = NAN
    gyro_y_dps: float = NAN
    gyro_z_dps: float = NAN
    accel_x_g: float = NAN
    accel_y_g: float = NAN
    accel_z_g: float = NAN
    mag_x_ut: float = NAN
    mag_y_ut: float = NAN
    mag_z_ut: float = NAN

    def pack(self) -> bytes:
        return _IMU.pack(*self)


Sample = GpsSample | CompassSample | ImuSample


def unpack(record: bytes) -> Sample:
    """The sample of one 112-byte record; ValueError when its size or source is wrong."""
    if len(record) != SAMPLE_SIZE:
        raise ValueError(f"a sample record has {SAMPLE_SIZE} bytes, not {len(record)}")
    _, source = _HEAD.unpack_from(record)
    if 0 <= source < MAX_GPS:
        return GpsSample(*_GPS.unpack(record))
    if source == COMPASS:
        return CompassSample(*_COMPASS.unpack(record))
    if source == IMU:
        return ImuSample(*_IMU.unpack(record))
    raise ValueError(f"a sample record names source {source}; 0 to {IMU} exist")

"""The EBIMU's ASCII lines and HEX frames."""

from __future__ import annotations

import math
import struct

import pytest

from acquisition.decoder import DecoderConfigError, make_decoder
from acquisition.ebimu import EbimuAsciiDecoder, EbimuHexDecoder, GroupsError
from acquisition.sample import IMU, ImuSample

LINE = b"*1.49,1.97,-5.44,7.27,0.48,1.92,-0.027,0.041,0.994"


def hex_frame(values: list[int]) -> bytes:
    body = b"\x55\x55" + struct.pack(f">{len(values)}h", *values)
    return body + struct.pack(">H", sum(body) & 0xFFFF)


def test_default_line_is_angles_gyro_accelerometer() -> None:
    decoder = EbimuAsciiDecoder()
    (sample,) = decoder.decode(70_850, LINE)
    assert sample[:12] == (70_850, IMU, 0, 1.49, 1.97, -5.44, 7.27, 0.48, 1.92, -0.027, 0.041, 0.994)
    assert all(math.isnan(value) for value in sample[12:])
    assert decoder.counts == {"lines": 1, "samples": 1}


def test_groups_say_which_columns_follow_and_in_which_order() -> None:
    (sample,) = EbimuAsciiDecoder("accel, gyro ,mag").decode(1, b"*1,2,3,.1,.2,.9,4,5,6,30,-20,45")
    assert sample == ImuSample(1, IMU, 0, 1, 2, 3, 4, 5, 6, 0.1, 0.2, 0.9, 30, -20, 45)


def test_without_groups_a_line_is_three_angles() -> None:
    (sample,) = EbimuAsciiDecoder("").decode(1, b"*-1.5,2,179.99")
    assert sample[3:6] == (-1.5, 2.0, 179.99)
    assert math.isnan(sample.gyro_z_dps)
    assert math.isnan(sample.accel_z_g)


def test_magnetometer_alone_leaves_gyro_and_accelerometer_missing() -> None:
    (sample,) = EbimuAsciiDecoder("mag").decode(1, b"*1,2,3,30,-20,45")
    assert sample[12:] == (30.0, -20.0, 45.0)
    assert math.isnan(sample.gyro_x_dps)


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"*",
        LINE[1:],
        LINE + b",1",
        LINE.rpartition(b",")[0],
        LINE.replace(b"7.27", b"nan"),
        LINE.replace(b"0.994", b"inf"),
        LINE.replace(b"7.27", b"-inf"),
        LINE.replace(b"7.27", b""),
        LINE.replace(b"7.27", b"7_27"),
        LINE.replace(b"7.27", b"7.2x"),
        LINE.replace(b"7.27", b"9000"),
        LINE.replace(b"0.994", b"-99.4"),
        LINE.replace(b"-5.44", b"-544"),
        b"\xff\x00\x80" + LINE,
        LINE[:20] + LINE,
    ],
)
def test_a_line_that_cannot_be_true_is_malformed(line: bytes) -> None:
    decoder = EbimuAsciiDecoder()
    assert decoder.decode(1, line) == ()
    assert decoder.counts == {"lines": 1, "malformed": 1}
    assert decoder.last_error.startswith("malformed: ")
    assert len(decoder.decode(2, LINE)) == 1


def test_nmea_on_the_imu_port_is_foreign_and_an_answer_to_a_command_is_not_an_error() -> None:
    decoder = EbimuAsciiDecoder()
    assert decoder.decode(1, b"$HCHDM,123.4,M*2F") == ()
    assert decoder.decode(2, b"<ok>") == ()
    assert decoder.counts == {"lines": 2, "foreign": 1, "unused": 1}


def test_hex_frame_scales() -> None:
    decoder = EbimuHexDecoder("gyro,accel,mag")
    frame = hex_frame([149, -197, -17999, 727, -48, 192, -27, 41, 994, 301, -202, 455])
    assert decoder.framing().feed(b"\x00" + frame) == [frame]
    (sample,) = decoder.decode(5, frame)
    assert sample == ImuSample(
        5, IMU, 0, 1.49, -1.97, -179.99, 72.7, -4.8, 19.2, -0.027, 0.041, 0.994, 30.1, -20.2, 45.5
    )


def test_hex_frames_that_are_none_are_counted() -> None:
    decoder = EbimuHexDecoder()
    frame = hex_frame([0] * 9)
    assert decoder.decode(1, frame[:-1] + b"\x00") == ()
    assert decoder.decode(2, hex_frame([0] * 12)) == ()
    assert decoder.decode(3, b"") == ()
    assert decoder.decode(4, LINE) == ()
    assert len(decoder.decode(5, frame)) == 1
    assert decoder.counts == {"lines": 5, "samples": 1, "checksum": 1, "malformed": 2, "foreign": 1}


@pytest.mark.parametrize("groups", ["giro", "gyro,gyro", "angles", "gyro;accel"])
def test_groups_that_do_not_exist_are_an_error(groups: str) -> None:
    with pytest.raises(GroupsError, match="groups"):
        EbimuAsciiDecoder(groups)


def test_make_decoder_builds_what_the_config_names_and_says_what_is_wrong() -> None:
    assert isinstance(make_decoder("imu", "ebimu-hex", {"groups": "accel"}), EbimuHexDecoder)
    assert isinstance(make_decoder("imu", "ebimu-ascii", {}), EbimuAsciiDecoder)
    for source, driver, options, message in [
        ("imu", "nmea", {}, "ebimu-ascii and ebimu-hex"),
        ("imu", "ebimu-ascii", {"grups": ""}, "did you mean groups"),
        ("imu", "ebimu-ascii", {"groups": "giro"}, "imu: groups"),
        ("gps1", "nmea", {"checksum": 1}, "is a bool"),
        ("gps9", "nmea", {}, "did you mean gps"),
    ]:
        with pytest.raises(DecoderConfigError, match=message):
            make_decoder(source, driver, options)  # type: ignore[arg-type]

"""The packets between the live program and its output process come out as they went in."""

from __future__ import annotations

import pytest

from tinyekf_py.estimate import Estimate
from tinyekf_py.outputs.frame import MAX_PACKET, Answer, Frame, LogLine, Packet, Request, decode, encode
from tinyekf_py.view_state import Navigation, SensorRow, TaskRow, ViewState

NAN = float("nan")
FULL = ViewState(
    Estimate(1_000_000, 359.99, 0.4, -1.5, 35.96, 126.53, "ok", "gps", (3.0, 2.0), (359.0, NAN), 1.0, (0.5, 1.5)),
    sensors=(SensorRow("gps1", "open", 10.0, 0.05, dropped=(("checksum", 3),)), SensorRow("imu", "open")),
    notices=('a \\ b " \u2028 \x1b',),
    tasks=(TaskRow("1", "gps1", True),),
    navigation=Navigation(utc_s=1.7e9, sog_mps=4.0),
)


@pytest.mark.parametrize(
    "packet",
    [
        Frame(12.5, FULL),
        Frame(0.0, ViewState(None)),
        Request(7, ("stop", "gps2")),
        Answer(7, {"error": "no"}),
        LogLine(30, "a port is taken"),
    ],
)
def test_a_packet_survives_the_link(packet: Packet) -> None:
    back = decode(encode(packet))
    assert type(back) is type(packet)
    assert repr(back) == repr(packet)  # NaN included


def test_the_longest_frame_fits_a_packet() -> None:
    rows = tuple(SensorRow(f"gps{i}", "x" * 40, last_error="\u2028" * 200, port_text="é" * 200) for i in range(1, 11))
    state = FULL._replace(sensors=rows, notices=("\x00" * 500,) * 5, tasks=(TaskRow("q", "cnw-s1", True),) * 21)
    assert len(encode(Frame(1.0, state))) < MAX_PACKET

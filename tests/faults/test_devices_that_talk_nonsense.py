"""Devices that flood, garble, stop in the middle of a sentence, or tell a wrong time: one program lives through it."""

from __future__ import annotations

import os
import random
import threading
import time
from datetime import datetime, timedelta
from typing import Any

import pytest
from live_boat import DEADLINE_S

GPS = ("gps1", "gps2", "gps3")
SLACK_S = 1.0


def after(seconds: float) -> Any:
    """Holds once some time has passed: for faults that nobody is to notice."""
    end: list[float] = []

    def passed(_status: dict[str, Any]) -> bool:
        end.append(time.monotonic() + seconds)
        return time.monotonic() >= end[0]

    return passed


def set_mangle(life: Any, names: tuple[str, ...], mangle: Any) -> None:
    for name in names:
        life.boat.cables[name].mangle = mangle


def test_a_megabyte_a_second_of_noise_on_a_gps_port(life: Any) -> None:
    cable, ended = life.boat.cables["gps2"], threading.Event()
    noise = random.Random(1).randbytes(10_000)

    def make_noise() -> None:
        while not ended.wait(0.01):
            with cable.lock:
                cable.write(noise)

    thread = threading.Thread(target=make_noise)

    def end() -> None:
        ended.set()
        thread.join()

    life.row(
        "1 MB/s of noise on gps2",
        thread.start,
        lambda s: s["mode"] == "degraded" and sum(s["sensors"]["gps2"]["dropped"].values()) > 0,
        end,
        broken=("gps2",),
    )


def test_nmea_at_1000_hz(life: Any) -> None:
    life.row(
        "compass at 1000 Hz for 3 s",
        lambda: set_mangle(life, ("compass",), lambda line: (line + b"\r\n") * 50),
        after(3.0),
        lambda: set_mangle(life, ("compass",), None),
    )


def test_bytes_as_at_a_wrong_baud_rate(life: Any) -> None:
    garbage = random.Random(2)
    life.row(
        "gps3 garbled as by a wrong baud rate",
        lambda: set_mangle(life, ("gps3",), lambda line: garbage.randbytes(len(line))),
        lambda s: s["mode"] != "ok",
        lambda: set_mangle(life, ("gps3",), None),
        broken=("gps3",),
    )


def test_half_a_sentence_and_then_silence_past_the_reopening(life: Any) -> None:
    cable = life.boat.cables["gps1"]
    halves = iter([b"$GPGGA,0300"])

    def half(_line: bytes) -> bytes | None:
        return next(halves, None)

    opens = []

    def reopened(status: dict[str, Any]) -> bool:
        opens.append(time.monotonic())
        return status["sensors"]["gps1"]["port_state"] == "stale" and opens[-1] - opens[0] > 6.0

    life.row(
        "gps1: half a sentence, then 6 s of silence",
        lambda: setattr(cable, "mangle", half),
        reopened,
        lambda: setattr(cable, "mangle", None),
        broken=("gps1",),
    )


def shifted(line: bytes, by: timedelta) -> bytes:
    """A sentence with its UTC moved."""
    fields = line[1:].partition(b"*")[0].decode().split(",")
    kind = fields[0][2:]
    if kind in ("GGA", "RMC", "GLL") and fields[1]:
        date = fields[9] if kind == "RMC" else "010126"
        when = datetime.strptime(date + fields[1][:6], "%d%m%y%H%M%S") + by
        fields[1] = when.strftime("%H%M%S") + fields[1][6:]
        if kind == "RMC":
            fields[9] = when.strftime("%d%m%y")
    body = ",".join(fields).encode()
    checksum = 0
    for octet in body:
        checksum ^= octet
    return b"$%b*%02X" % (body, checksum)


@pytest.mark.parametrize(("what", "by"), [("back 1 h", timedelta(hours=-1)), ("on 20 years", timedelta(days=7305))])
def test_gps_time_jumps(life: Any, what: str, by: timedelta) -> None:
    row = life.row(
        f"GPS time jumps {what} for 3 s, and back",
        lambda: set_mangle(life, GPS, lambda line: shifted(line, by) + b"\r\n"),
        after(3.0),
        lambda: set_mangle(life, GPS, None),
    )
    assert row.whole_s <= 2.0 + SLACK_S


def sticks(life: Any, name: str, fault: str, limit_s: float) -> None:
    """A row of the matrix: a device repeats what it says, kind by kind, until it has been noticed."""
    cable = life.boat.cables[name]
    stuck: dict[bytes, bytes] = {}  # by the kind of sentence; an IMU has one

    def same(line: bytes) -> bytes:
        return stuck.setdefault(line[:6] if line.startswith(b"$") else b"", line) + b"\r\n"

    life.row(
        fault,
        lambda: setattr(cable, "mangle", same),
        lambda s: s["mode"] == "degraded",
        lambda: setattr(cable, "mangle", None),
        limit_s=limit_s,
    )


@pytest.mark.parametrize(
    ("name", "fault", "limit_s"),
    [
        ("imu", "imu stuck at one value", DEADLINE_S),
        ("compass", "compass stuck at one value (noticed once the boat has turned 10°)", 90.0),  # a leg takes 45 s
    ],
)
def test_a_sensor_sticks_at_one_value(life: Any, name: str, fault: str, limit_s: float) -> None:
    sticks(life, name, fault, limit_s)


def test_the_compass_sticks_aboard_a_boat_without_an_imu(own_life: Any) -> None:
    life = own_life(config="enabled = false\n")  # of the last device, the IMU
    life.boat.cables["imu"].mangle = lambda line: None
    sticks(life, "compass", "compass stuck at one value, without an IMU (noticed once the course has turned)", 120.0)
    assert life.live.end() == 0


def test_the_configuration_file_vanishes(life: Any) -> None:
    cable = life.boat.cables["gps1"]

    def lose() -> None:
        os.unlink(life.live.config)
        cable.unplug()

    life.row(
        "configuration file removed, gps1 replugged",
        lose,
        lambda s: s["sensors"]["gps1"]["port_state"] == "absent" and s["mode"] != "ok",
        cable.plug,
        broken=("gps1",),
    )

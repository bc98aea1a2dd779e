"""One worker as a real process on a real pty, spoken to over its pipes."""

from __future__ import annotations

import fcntl
import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import pytest

from acquisition.decoder import make_decoder
from acquisition.device import DeviceSettings
from acquisition.message import COUNTS, ERROR, HELLO, LINE, LOG, PORT, Message
from acquisition.sample import ImuSample, unpack
from acquisition.worker_process import WorkerProcess

DEADLINE_S = 15.0
IMU_LINE = b"*1.49,1.97,-5.44,7.27,0.48,1.92,-0.027,0.041,0.994"


def imu_line(number: int) -> bytes:
    """A line that tells its number."""
    return b"*0.00,0.00,%.2f,0.00,0.00,0.00,0.000,0.000,1.000" % (number / 100)


class Reader:
    """A worker and what it said so far."""

    def __init__(self, settings: DeviceSettings, polling: bool = True) -> None:
        self.process = WorkerProcess(settings, time.monotonic_ns() // 1000, polling)
        self.messages: list[Message] = []

    def read(self, timeout_s: float) -> bool:
        """Take one read of messages; False when none came in time, or the worker ended."""
        ready, _, _ = select.select([self.process], [], [], timeout_s)
        received = self.process.receive() if ready else []
        self.messages += received or []
        return bool(received)

    def until(self, found: Callable[[Message], object]) -> Message:
        """The first message not returned yet that is the one; fails at the deadline."""
        end = time.monotonic() + DEADLINE_S
        while True:
            while self.messages:
                message = self.messages.pop(0)
                if found(message):
                    return message
            assert time.monotonic() < end, "the message did not come"
            self.read(0.5)

    def until_kind(self, kind: int) -> Message:
        return self.until(lambda message: message.kind == kind)

    def until_port(self, state: str) -> Message:
        return self.until(lambda message: message.kind == PORT and message.text.split()[0] == state)

    def until_line(self, line: bytes) -> Message:
        return self.until(lambda message: message.kind == LINE and message.line == line)

    def until_counts(self, found: Callable[[dict[str, int]], object]) -> dict[str, int]:
        message = self.until(lambda message: message.kind == COUNTS and found(json.loads(message.line)))
        counts: dict[str, int] = json.loads(message.line)
        return counts


@pytest.fixture
def start() -> Iterator[Callable[..., Reader]]:
    """Starts a worker; ends it after the test."""
    readers: list[Reader] = []

    def make(settings: DeviceSettings, polling: bool = True) -> Reader:
        readers.append(Reader(settings, polling))
        return readers[-1]

    yield make
    for reader in readers:
        reader.process.kill()
        assert reader.process.ended_by(time.monotonic() + DEADLINE_S)
        reader.process.release()


def test_it_shakes_hands_opens_its_port_and_sends_a_line_with_its_sample(new_device, start) -> None:
    device = new_device("fjIMU")
    imu = start(DeviceSettings("imu", device.path, "ebimu-ascii"))
    hello = json.loads(imu.until_kind(HELLO).line)
    assert hello == {"pid": imu.process.pid, "driver": "ebimu-ascii"}
    imu.until_port("open")
    device.write(IMU_LINE + b"\r\n")
    message = imu.until_kind(LINE)
    sample = unpack(message.samples)
    assert message.line == IMU_LINE
    assert isinstance(sample, ImuSample)
    assert (sample.t_us, sample.yaw_deg, sample.accel_z_g) == (message.t_us, -5.44, 0.994)


def test_a_half_line_and_silence_give_a_silent_port_and_no_line(new_device, start) -> None:
    device = new_device("fjEC")
    compass = start(DeviceSettings("compass", device.path, "nmea"))
    compass.until_port("open")
    device.write(b"$HCHDM,123")
    compass.until_port("silent")
    device.write(b".4,M*2D\r\n")
    compass.until_port("open")
    message = compass.until_kind(LINE)
    assert message.line == b"$HCHDM,123.4,M*2D"


def test_a_device_slower_than_a_second_is_not_called_silent(new_device, start) -> None:
    device = new_device("fjGPS1")
    gps = start(DeviceSettings("gps1", device.path, "nmea", options={"period_ms": 2000}))
    gps.until_port("open")
    for _ in range(2):
        gps.until_kind(COUNTS)
    device.write(b"$GPGSV,1,1,00*79\r\n")
    states = []
    gps.until(lambda message: (message.kind == PORT and states.append(message.text)) or message.kind == LINE)
    assert states == []


def test_a_slow_reader_loses_the_oldest_lines_counted_and_the_port_is_never_blocked(new_device, start) -> None:
    device = new_device("fjIMU")
    imu = start(DeviceSettings("imu", device.path, "ebimu-ascii"))
    imu.until_port("open")
    sent = 0
    unread_end = time.monotonic() + DEADLINE_S
    while sent < 1000:  # nobody reads the messages meanwhile: the pty must go on taking bytes
        line = imu_line(sent) + b"\r\n"
        if device.write(line) == len(line):
            sent += 1
        assert time.monotonic() < unread_end, "the worker does not empty its port"
        select.select([], [], [], 0.001)
    counts = imu.until_counts(lambda counts: counts["samples"] + counts.get("slow-reader", 0) == sent)
    assert counts["slow-reader"] > 0
    device.write(b"*0.00,0.00,179.00,0.00,0.00,0.00,0.000,0.000,1.000\r\n")
    imu.until_line(b"*0.00,0.00,179.00,0.00,0.00,0.00,0.000,0.000,1.000")


def test_what_was_dropped_was_never_decoded_so_the_rest_decodes_the_same_again(new_device, start) -> None:
    device = new_device("fjIMU")
    imu = start(DeviceSettings("imu", device.path, "ebimu-ascii"))
    imu.until_port("open")
    for number in range(600):
        line = imu_line(number) + b"\r\n"
        while device.write(line) == 0:
            select.select([], [], [], 0.001)
        select.select([], [], [], 0.001)
    lines: list[Message] = []
    imu.until(lambda message: (message.kind == LINE and lines.append(message)) or message.line == imu_line(599))
    decoder = make_decoder("imu", "ebimu-ascii", {})
    again = [b"".join(sample.pack() for sample in decoder.decode(line.t_us, line.line)) for line in lines]
    assert again == [line.samples for line in lines]
    assert len(lines) < 600
    numbers = [line.line for line in lines]
    assert numbers == sorted(numbers, key=[imu_line(number) for number in range(600)].index)


def test_a_device_that_is_not_there_is_reported_once_and_opened_when_it_comes(new_device, start) -> None:
    device = new_device("fjIMU")
    device.unplug()
    imu = start(DeviceSettings("imu", device.path, "ebimu-ascii"))
    imu.until_port("absent")
    states = []
    beats = 0

    def second_beat(message: Message) -> bool:
        nonlocal beats
        beats += message.kind == COUNTS
        if message.kind == PORT:
            states.append(message.text)
        return beats == 2

    imu.until(second_beat)
    assert states == []
    device.plug()
    imu.until_port("open")
    device.write(IMU_LINE + b"\r\n")
    imu.until_line(IMU_LINE)


def test_a_device_replugged_under_another_name_is_opened_again(new_device, start) -> None:
    device = new_device("fjIMU")
    imu = start(DeviceSettings("imu", device.path, "ebimu-ascii"))
    imu.until_port("open")
    first = os.readlink(device.path)
    held, other = os.openpty()  # takes the next number, so that the device comes back under a new one
    device.write(b"*1.49,1.97,-5")
    device.unplug()
    imu.until_port("lost")
    taken = os.openpty()
    device.plug()
    assert os.readlink(device.path) != first
    imu.until_port("open")
    device.write(IMU_LINE + b"\r\n")
    imu.until_line(IMU_LINE)  # the half line from before is forgotten, not glued to this one
    for fd in (held, other, *taken):
        os.close(fd)


def test_a_silent_device_is_opened_again_and_its_port_is_not_reported_twice(new_device, start) -> None:
    device = new_device("fjIMU")
    imu = start(DeviceSettings("imu", device.path, "ebimu-ascii"))
    imu.until_port("silent")
    counts = imu.until_counts(lambda counts: counts["opens"] >= 2)
    assert counts["down_ms"] >= 3000
    device.write(IMU_LINE + b"\r\n")
    imu.until_port("open")
    imu.until_line(IMU_LINE)


def test_a_port_without_permission_is_denied_and_opened_once_permitted(new_device) -> None:
    """Root may open everything: it gives that right up for the run."""
    device = new_device("fjIMU")
    node = os.path.realpath(device.path)
    os.chmod(node, 0)
    code = (
        "import sys; from acquisition.device import DeviceSettings; from acquisition.supervisor import Supervisor\n"
        "s = Supervisor([DeviceSettings('imu', sys.argv[1], 'ebimu-ascii')], 0)\n"
        "while s.states['imu'].port_state != 'open':\n"
        "    for name, message in s.poll(0.5):\n"
        "        if message.kind == 2: print(message.text, flush=True)\n"
        "s.close()\n"
    )
    modest = ["setpriv", "--bounding-set=-dac_override,-dac_read_search"] if os.getuid() == 0 else []
    program = subprocess.Popen([*modest, sys.executable, "-c", code, device.path], stdout=subprocess.PIPE, text=True)
    assert program.stdout is not None
    denied = program.stdout.readline()
    assert denied.startswith(f"denied {device.path} may not be opened")
    os.chmod(node, 0o600)
    output, _ = program.communicate(timeout=DEADLINE_S)
    assert output.startswith("open ")
    assert program.returncode == 0


def test_noise_at_full_speed_is_throttled_counted_and_lines_pass_again_after_it(new_device, start) -> None:
    device = new_device("fjGPS1")
    gps = start(DeviceSettings("gps1", device.path, "nmea"))
    gps.until_port("open")
    noise = bytes(range(256)) * 16
    sent = 0
    end = time.monotonic() + DEADLINE_S
    while sent < 300_000:
        sent += device.write(noise)
        assert time.monotonic() < end
        gps.read(0.0005)
    counts = gps.until_counts(lambda counts: counts.get("flood-bytes", 0) > 0)
    assert counts["flood-bytes"] < counts["bytes"]
    assert gps.until_kind(LOG).text.startswith("dropped so far: ")
    sentence = b"$GPGSV,1,1,00*79"

    def sentence_came() -> bool:
        device.write(b"\r\n" + sentence + b"\r\n")
        gps.read(0.2)
        return any(message.line == sentence for message in gps.messages)

    end = time.monotonic() + DEADLINE_S
    while not sentence_came():
        assert time.monotonic() < end


def test_a_line_without_end_costs_no_memory_and_the_next_line_passes(new_device, start) -> None:
    device = new_device("fjIMU")
    imu = start(DeviceSettings("imu", device.path, "ebimu-ascii"))
    imu.until_port("open")
    for _ in range(5):
        device.write(b"x" * 1000)
        select.select([], [], [], 0.01)
    device.write(b"\r\n" + IMU_LINE + b"\r\n")
    imu.until_line(IMU_LINE)
    assert imu.until_counts(lambda counts: counts.get("overlong"))["overlong"] == 1


def test_stop_closes_the_port_and_start_opens_it_again(new_device, start) -> None:
    device = new_device("fjIMU")
    imu = start(DeviceSettings("imu", device.path, "ebimu-ascii"), polling=False)
    imu.until_kind(COUNTS)
    imu.process.command("start")
    imu.until_port("open")
    imu.process.command("stop")
    imu.until_port("closed")
    free = os.open(device.path, os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(free, fcntl.LOCK_EX | fcntl.LOCK_NB)  # nobody holds it
    os.close(free)
    imu.process.command("start")
    imu.until_port("open")
    device.write(IMU_LINE + b"\r\n")
    imu.until_line(IMU_LINE)


def test_reset_says_from_where_a_fresh_decoder_decodes(new_device, start) -> None:
    device = new_device("fjIMU")
    imu = start(DeviceSettings("imu", device.path, "ebimu-ascii"))
    imu.until_port("open")
    device.write(IMU_LINE + b"\r\n")
    imu.until_line(IMU_LINE)
    imu.process.command("reset")
    imu.until_kind(HELLO)
    device.write(IMU_LINE + b"\r\n")
    imu.until_line(IMU_LINE)
    assert imu.until_counts(lambda counts: True)["lines"] == 2


def test_an_exception_reaches_the_parent_and_ends_the_worker(new_device, start) -> None:
    device = new_device("fjIMU")
    imu = start(DeviceSettings("imu", device.path, "no-such-driver"))
    error = imu.until_kind(ERROR)
    assert error.text.startswith("Traceback")
    assert "no-such-driver" in error.text
    assert imu.process.ended_by(time.monotonic() + DEADLINE_S)


def test_it_goes_when_asked_and_when_its_parent_closes_the_pipe(new_device, start) -> None:
    device = new_device("fjIMU")
    asked = start(DeviceSettings("imu", device.path, "ebimu-ascii"))
    asked.until_port("open")
    asked.process.ask()
    assert asked.process.ended_by(time.monotonic() + DEADLINE_S)
    left = start(DeviceSettings("imu", device.path, "ebimu-ascii"))
    left.until_port("open")
    left.process.release()
    assert left.process.ended_by(time.monotonic() + DEADLINE_S)

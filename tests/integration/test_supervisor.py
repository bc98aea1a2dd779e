"""The supervisor with real workers on real ptys: what dies is restarted, what hangs is killed, all end in time."""

from __future__ import annotations

import contextlib
import logging
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import pytest

from acquisition.device import DeviceError, DeviceSettings
from acquisition.message import HELLO, LINE, PORT, RESTART, Message
from acquisition.supervisor import Supervisor

DEADLINE_S = 20.0
IMU_LINE = b"*1.49,1.97,-5.44,7.27,0.48,1.92,-0.027,0.041,0.994"
COMPASS_LINE = b"$HCHDM,123.4,M*2D"

Step = Callable[[], object]


class Crew:
    """A supervisor and all it passed on, per device."""

    def __init__(self, *devices: DeviceSettings) -> None:
        self.start_us = time.monotonic_ns() // 1000
        self.supervisor = Supervisor(devices, self.start_us)
        self.messages: dict[str, list[Message]] = {device.name: [] for device in devices}

    def poll(self, timeout_s: float = 0.1) -> None:
        for name, message in self.supervisor.poll(timeout_s):
            self.messages[name].append(message)

    def until(self, found: Step) -> None:
        """Poll until it is so; fails at the deadline."""
        end = time.monotonic() + DEADLINE_S
        while not found():
            assert time.monotonic() < end, f"not within {DEADLINE_S:.0f} s: {self.supervisor.states}"
            self.poll()

    def until_port(self, name: str, state: str) -> None:
        self.until(lambda: self.supervisor.states[name].port_state == state)

    def lines(self, name: str) -> list[bytes]:
        return [message.line for message in self.messages[name] if message.kind == LINE]

    def kinds(self, name: str) -> list[int]:
        return [message.kind for message in self.messages[name]]

    def until_line_after(self, name: str, write: Step) -> None:
        """Write until another line of the device has come all the way."""
        before = len(self.lines(name))

        def came() -> bool:
            write()
            return len(self.lines(name)) > before

        self.until(came)


def alive(pid: int) -> bool:
    """Whether the process runs: a zombie does not."""
    try:
        with open(f"/proc/{pid}/stat", encoding="ascii") as stat:
            return stat.read().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_until(found: Step, limit_s: float) -> None:
    end = time.monotonic() + limit_s
    while not found():
        assert time.monotonic() < end, f"not within {limit_s} s"
        select.select([], [], [], 0.01)


@pytest.fixture
def crew_of() -> Iterator[Callable[..., Crew]]:
    """Starts a crew; closes it after the test."""
    crews: list[Crew] = []

    def make(*devices: DeviceSettings) -> Crew:
        crews.append(Crew(*devices))
        return crews[-1]

    yield make
    for crew in crews:
        crew.supervisor.close()


@pytest.fixture
def imu_and_compass(new_device, crew_of):
    """A crew of two, both open, with their devices."""
    imu, compass = new_device("fjIMU"), new_device("fjEC")
    crew = crew_of(
        DeviceSettings("imu", imu.path, "ebimu-ascii"), DeviceSettings("compass", compass.path, "nmea", 9600)
    )
    crew.until_port("imu", "open")
    crew.until_port("compass", "open")
    return crew, imu, compass


def test_lines_of_all_devices_come_through_and_their_state_is_known(imu_and_compass) -> None:
    crew, imu, compass = imu_and_compass
    crew.until_line_after("imu", lambda: imu.write(IMU_LINE + b"\r\n"))
    crew.until_line_after("compass", lambda: compass.write(COMPASS_LINE + b"\r\n"))
    assert crew.lines("imu")[0] == IMU_LINE
    assert crew.lines("compass")[0] == COMPASS_LINE
    assert crew.kinds("imu")[:2] == [HELLO, PORT]
    states = crew.supervisor.states
    crew.until(lambda: states["imu"].counts["samples"] and states["compass"].counts["samples"])
    assert states["imu"].last_line_us == max(m.t_us for m in crew.messages["imu"] if m.kind == LINE)


def test_a_killed_worker_is_noticed_restarted_and_the_stream_says_so(imu_and_compass, caplog) -> None:
    crew, imu, _ = imu_and_compass
    crew.until_line_after("imu", lambda: imu.write(IMU_LINE + b"\r\n"))
    state = crew.supervisor.states["imu"]
    first, count = state.pid, len(crew.messages["imu"])
    with caplog.at_level(logging.ERROR):
        os.kill(first, signal.SIGKILL)
        crew.until(lambda: state.restarts == 1)
        crew.until_line_after("imu", lambda: imu.write(IMU_LINE + b"\r\n"))
    assert f"imu: worker {first} died; restart in 0.5 s" in caplog.text
    assert state.restarts == 1
    assert state.pid != first
    assert not alive(first)
    after = [kind for kind in crew.kinds("imu")[count:] if kind in (RESTART, HELLO, PORT, LINE)]
    assert after[after.index(RESTART) :][:3] == [RESTART, HELLO, PORT]
    assert RESTART not in crew.kinds("compass")
    assert crew.supervisor.states["compass"].restarts == 0


def test_counters_go_on_across_a_restart(imu_and_compass) -> None:
    crew, imu, _ = imu_and_compass
    state = crew.supervisor.states["imu"]
    crew.until_line_after("imu", lambda: imu.write(IMU_LINE + b"\r\n"))
    crew.until(lambda: state.counts["lines"] == len(crew.lines("imu")))
    os.kill(state.pid, signal.SIGKILL)
    crew.until_line_after("imu", lambda: imu.write(IMU_LINE + b"\r\n"))
    crew.until(lambda: state.counts["lines"] == len(crew.lines("imu")))
    assert state.restarts == 1


def test_a_hanging_worker_is_killed_and_restarted(imu_and_compass, caplog) -> None:
    crew, imu, _ = imu_and_compass
    state = crew.supervisor.states["imu"]
    first = state.pid
    os.kill(first, signal.SIGSTOP)
    crew.until(lambda: state.restarts == 1)
    crew.until_line_after("imu", lambda: imu.write(IMU_LINE + b"\r\n"))
    assert "gave no sign of life" in caplog.text
    assert not alive(first)
    assert RESTART in crew.kinds("imu")


def test_a_worker_that_dies_at_once_is_restarted_ever_more_slowly(new_device, crew_of, caplog) -> None:
    device = new_device("fjIMU")
    crew = crew_of(DeviceSettings("imu", device.path, "no-such-driver"))
    crew.until(lambda: crew.supervisor.states["imu"].restarts == 3)
    waits = [line.rpartition("restart in ")[2] for line in caplog.text.splitlines() if "restart in" in line]
    assert waits == ["0.5 s", "1.0 s", "2.0 s"]
    assert "no-such-driver" in crew.supervisor.states["imu"].last_error


def test_own_stall_is_not_blamed_on_the_workers(imu_and_compass) -> None:
    crew, imu, _ = imu_and_compass
    stalled = time.monotonic() + 5.5  # longer than a worker may be silent
    while time.monotonic() < stalled:
        imu.write(IMU_LINE + b"\r\n")
        select.select([], [], [], 0.05)
    crew.until_line_after("imu", lambda: imu.write(IMU_LINE + b"\r\n"))
    assert [state.restarts for state in crew.supervisor.states.values()] == [0, 0]


def test_after_a_stall_all_that_waited_comes_in_order_and_none_too_old(imu_and_compass) -> None:
    crew, imu, compass = imu_and_compass
    stalled = time.monotonic() + 3.0
    while time.monotonic() < stalled:
        imu.write(IMU_LINE + b"\r\n")
        compass.write(COMPASS_LINE + b"\r\n")
        select.select([], [], [], 0.01)
    came: list[int] = []
    resumed_us = time.monotonic_ns() // 1000 - crew.start_us
    while not came or came[-1] < resumed_us:
        imu.write(IMU_LINE + b"\r\n")
        came += [message.t_us for _, message in crew.supervisor.poll(0.1) if message.kind == LINE]
    newest = 0
    for t_us in came:
        assert t_us > newest - 1_000_000  # older than that, fusion would refuse it
        newest = max(newest, t_us)
    crew.until(lambda: crew.supervisor.states["compass"].counts["slow-reader"] > 0)


def test_polling_stops_and_starts_for_one_device_alone(imu_and_compass) -> None:
    crew, imu, compass = imu_and_compass
    crew.supervisor.set_polling("imu", False)
    crew.until_port("imu", "closed")
    crew.until_line_after("compass", lambda: compass.write(COMPASS_LINE + b"\r\n"))
    crew.supervisor.set_polling("imu", True)
    crew.until_port("imu", "open")
    crew.until_line_after("imu", lambda: imu.write(IMU_LINE + b"\r\n"))


def test_a_stopped_device_stays_stopped_when_its_worker_is_restarted(imu_and_compass) -> None:
    crew, _, _ = imu_and_compass
    crew.supervisor.set_polling("imu", False)
    crew.until_port("imu", "closed")
    os.kill(crew.supervisor.states["imu"].pid, signal.SIGKILL)
    crew.until(lambda: crew.kinds("imu").count(HELLO) == 2)
    count = len(crew.messages["imu"])
    crew.until(lambda: len(crew.messages["imu"]) > count)
    assert crew.supervisor.states["imu"].port_state == "closed"


def test_a_disabled_device_has_no_worker_until_it_is_started(new_device, crew_of) -> None:
    device = new_device("fjIMU")
    crew = crew_of(DeviceSettings("imu", device.path, "ebimu-ascii", enabled=False))
    crew.poll()
    assert crew.supervisor.states["imu"].pid == 0
    crew.supervisor.set_polling("imu", True)
    crew.until_port("imu", "open")


def test_a_reset_of_a_decoder_stands_in_the_stream(imu_and_compass) -> None:
    crew, _, _ = imu_and_compass
    crew.supervisor.reset_decoder("imu")
    crew.until(lambda: RESTART in crew.kinds("imu"))


def test_a_busy_device_does_not_crowd_out_another(imu_and_compass) -> None:
    crew, imu, compass = imu_and_compass

    def both() -> None:
        for _ in range(20):
            imu.write(IMU_LINE + b"\r\n")
        compass.write(COMPASS_LINE + b"\r\n")

    crew.until_line_after("compass", both)
    stamps = [message.t_us for message in crew.messages["imu"] if message.kind == LINE]
    assert stamps == sorted(stamps)


def test_close_ends_every_worker_within_two_seconds_also_stopped_ones(new_device) -> None:
    devices = [DeviceSettings(f"gps{n}", new_device(f"fjGPS{n}").path, "nmea") for n in (1, 2, 3)]
    crew = Crew(*devices)
    for device in devices:
        crew.until_port(device.name, "open")
    pids = [state.pid for state in crew.supervisor.states.values()]
    os.kill(pids[1], signal.SIGSTOP)
    begun = time.monotonic()
    crew.supervisor.close()
    assert time.monotonic() - begun < 2.0  # a promise of the program, not a measurement
    assert not any(os.path.exists(f"/proc/{pid}") for pid in pids)
    crew.supervisor.close()


def test_closing_leaves_no_descriptor_open(new_device) -> None:
    device = new_device("fjIMU")
    before = len(os.listdir("/proc/self/fd"))
    crew = Crew(DeviceSettings("imu", device.path, "ebimu-ascii"))
    crew.until_port("imu", "open")
    os.kill(crew.supervisor.states["imu"].pid, signal.SIGKILL)
    crew.until(lambda: crew.supervisor.states["imu"].restarts == 1)
    crew.until_port("imu", "open")
    crew.supervisor.close()
    assert len(os.listdir("/proc/self/fd")) == before


@pytest.mark.parametrize("stopped", [False, True], ids=["running", "stopped"])
def test_workers_end_within_two_seconds_of_their_parents_death(new_device, stopped: bool) -> None:
    device = new_device("fjIMU")
    code = (
        "import sys; from acquisition.device import DeviceSettings; from acquisition.supervisor import Supervisor\n"
        "s = Supervisor([DeviceSettings('imu', sys.argv[1], 'ebimu-ascii')], 0)\n"
        "while s.states['imu'].port_state != 'open': s.poll(1)\n"
        "print(s.states['imu'].pid, flush=True)\n"
        "while True: s.poll(1)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code, device.path], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    worker = int(parent.stdout.readline())
    if stopped:
        os.kill(worker, signal.SIGSTOP)
    parent.kill()
    parent.wait()
    with contextlib.closing(parent.stdout):
        wait_until(lambda: not alive(worker), 2.0)


def test_settings_that_cannot_be_right_are_refused() -> None:
    with pytest.raises(DeviceError, match="gps9"):
        DeviceSettings("gps9", "/dev/ttyS0", "nmea")
    with pytest.raises(DeviceError, match="port is empty"):
        DeviceSettings("gps1", "", "nmea")
    with pytest.raises(DeviceError, match="0 baud"):
        DeviceSettings("gps1", "/dev/ttyS0", "nmea", 0)

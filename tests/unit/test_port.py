"""Ports: real ptys, a real TCP server, and what goes wrong with each."""

from __future__ import annotations

import fcntl
import os
import select
import socket
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import serial

from acquisition.port import Port, open_port
from acquisition.port_error import PortAbsentError, PortBusyError, PortError, PortLostError, PortUnusableError

DEADLINE_S = 10.0
NOBODY = 65534


class Pty:
    """A pty: `path` is the device, `master` its far end."""

    def __init__(self) -> None:
        self.master, slave = os.openpty()
        self.path = os.ttyname(slave)
        os.close(slave)

    def write(self, chunk: bytes) -> None:
        os.write(self.master, chunk)

    def close(self) -> None:
        if self.master >= 0:
            os.close(self.master)
            self.master = -1


@pytest.fixture
def pty() -> Iterator[Pty]:
    device = Pty()
    yield device
    device.close()


@pytest.fixture
def server() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        listening.settimeout(DEADLINE_S)
        yield listening


def url_of(server: socket.socket) -> str:
    return f"socket://127.0.0.1:{server.getsockname()[1]}"


def read_until(port: Port, wanted: bytes) -> bytes:
    """What the port gives until `wanted` is complete; fails at the deadline."""
    got, end = b"", time.monotonic() + DEADLINE_S
    while len(got) < len(wanted):
        ready, _, _ = select.select([port], [], [], max(0.0, end - time.monotonic()))
        assert ready, f"only {got!r} came"
        got += port.read()
    return got


def wait_connected(port: Port) -> None:
    """pyserial discards what came before it was ready."""
    end = time.monotonic() + DEADLINE_S
    while not port.connected:
        assert time.monotonic() < end, "not connected"
        select.select([port], [], [], 0.01)


def error_of(port: Port) -> PortError:
    """The error that reading the port ends with; fails at the deadline."""
    end = time.monotonic() + DEADLINE_S
    while True:
        ready, _, _ = select.select([port], [], [], max(0.0, end - time.monotonic()))
        assert ready, "the port is still there"
        try:
            port.read()
        except PortError as error:
            return error


def flags(port: Port) -> list[object]:
    return termios.tcgetattr(port.fileno())


def test_a_pty_gives_every_byte_unchanged_and_nothing_when_there_is_nothing(pty: Pty) -> None:
    port = open_port(pty.path, 115200)
    assert port.read() == b""
    every = bytes(range(256))
    pty.write(every)
    assert read_until(port, every) == every
    assert port.read() == b""
    port.close()


def test_bytes_from_before_the_opening_are_not_taken_for_new(pty: Pty) -> None:
    first = open_port(pty.path, 115200)
    pty.write(b"old")
    select.select([first], [], [], DEADLINE_S)
    first.close()
    port = open_port(pty.path, 115200)
    pty.write(b"new")
    assert read_until(port, b"new") == b"new"
    port.close()


def test_opening_clears_hupcl_so_that_closing_keeps_dtr(pty: Pty) -> None:
    with serial.Serial(pty.path):
        pass
    port = open_port(pty.path, 9600)
    assert not flags(port)[2] & termios.HUPCL
    port.close()
    fd = os.open(pty.path, os.O_RDWR | os.O_NOCTTY)
    assert not termios.tcgetattr(fd)[2] & termios.HUPCL
    os.close(fd)


def test_opening_touches_no_modem_line(pty: Pty, tmp_path: Path) -> None:
    """The system calls themselves: no ioctl sets DTR or RTS."""
    strace = subprocess.run(["sh", "-c", "command -v strace"], capture_output=True, text=True, check=False).stdout
    if not strace:
        pytest.skip("strace is not installed")
    log = tmp_path / "calls"
    code = f"from acquisition.port import open_port; open_port({pty.path!r}, 9600).close()"
    subprocess.run([strace.strip(), "-e", "ioctl", "-o", log, sys.executable, "-c", code], check=True)
    calls = log.read_text()
    assert "TCSETS" in calls
    assert "TIOCM" not in calls


@pytest.mark.parametrize(("baud", "speed"), [(9600, termios.B9600), (115200, termios.B115200)])
def test_the_baud_rate_is_set(pty: Pty, baud: int, speed: int) -> None:
    port = open_port(pty.path, baud)
    assert flags(port)[4:6] == [speed, speed]
    port.close()


def test_a_baud_rate_without_a_name_is_set_too(pty: Pty) -> None:
    port = open_port(pty.path, 250_000)
    settings = fcntl.ioctl(port.fileno(), 0x802C542A, bytes(44))  # TCGETS2 of Linux; stty does not know such speeds
    assert struct.unpack_from("2I", settings, 36) == (250_000, 250_000)
    pty.write(b"\x03\x11\r\n")
    assert read_until(port, b"\x03\x11\r\n") == b"\x03\x11\r\n"
    port.close()


def test_two_programs_do_not_share_a_port(pty: Pty) -> None:
    port = open_port(pty.path, 9600)
    with pytest.raises(PortBusyError, match="held by another program"):
        open_port(pty.path, 9600)
    with pytest.raises(serial.SerialException, match="exclusively lock"):
        serial.Serial(pty.path, exclusive=True)
    port.close()
    open_port(pty.path, 9600).close()


def test_a_missing_device_is_absent(tmp_path: Path) -> None:
    with pytest.raises(PortAbsentError, match="fjGPS1 is not there"):
        open_port(str(tmp_path / "fjGPS1"), 9600)
    (tmp_path / "fjEC").symlink_to(tmp_path / "ttyACM9")
    with pytest.raises(PortAbsentError, match="fjEC is not there"):
        open_port(str(tmp_path / "fjEC"), 9600)


def test_a_file_is_no_serial_device(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("no device")
    with pytest.raises(PortUnusableError, match="no serial device"):
        open_port(str(path), 9600)


def test_a_device_of_somebody_else_is_denied(pty: Pty) -> None:
    """As another user, since root may open everything; without root by a device of root's."""
    code = (
        "import os, sys; from acquisition.port import *\n"
        f"os.getuid() or os.setuid({NOBODY})\n"
        "try: open_port(sys.argv[1], 9600)\n"
        "except PortDeniedError as error: print('denied:', error.strerror)\n"
    )
    path = pty.path if os.getuid() == 0 else "/dev/console"
    if os.getuid() == 0:
        os.chmod(path, 0o600)
    answer = subprocess.run([sys.executable, "-c", code, path], capture_output=True, text=True, check=False)
    assert answer.stdout.startswith(f"denied: {path} may not be opened"), answer.stderr


def test_a_pty_stays_open_to_others_after_its_reader_was_killed(pty: Pty) -> None:
    """TIOCEXCL on a pty would outlive its owner and lock out all but root."""
    code = (
        "import os, sys; from acquisition.port import *\n"
        f"os.getuid() or os.setuid({NOBODY})\n"
        "port = open_port(sys.argv[1], 9600); print('open', flush=True)\n"
        "os.kill(os.getpid(), 9)\n"
    )
    os.chmod(pty.path, 0o666)
    for _ in range(2):
        answer = subprocess.run([sys.executable, "-c", code, pty.path], capture_output=True, text=True, check=False)
        assert answer.stdout == "open\n", answer.stderr


def test_a_device_that_goes_is_lost(pty: Pty) -> None:
    port = open_port(pty.path, 9600)
    pty.write(b"last words")
    assert read_until(port, b"last words") == b"last words"
    pty.close()
    assert isinstance(error_of(port), PortLostError)
    port.close()
    port.close()


def test_a_network_device_is_read_like_any_other(server: socket.socket) -> None:
    port = open_port(url_of(server), 9600)
    peer, _ = server.accept()
    wait_connected(port)
    sentence = b"$GPGGA,030000.00,,,,,0,,,,,,,,*64\r\n" * 300
    peer.sendall(sentence)
    assert read_until(port, sentence) == sentence
    peer.close()
    assert isinstance(error_of(port), PortLostError)
    port.close()


def test_a_network_device_that_does_not_answer_is_absent(server: socket.socket) -> None:
    url = url_of(server)
    server.close()
    port = open_port(url, 9600)
    error = error_of(port)
    assert isinstance(error, PortAbsentError)
    assert "does not answer" in str(error)
    port.close()


def test_closing_gives_a_network_device_back(server: socket.socket) -> None:
    port = open_port(url_of(server), 9600)
    peer, _ = server.accept()
    peer.settimeout(DEADLINE_S)
    port.close()
    assert peer.recv(1) == b""
    peer.close()


@pytest.mark.parametrize("url", ["socket:/gps", "carrier-pigeon://home"])
def test_a_url_that_nobody_opens_is_unusable_or_absent(url: str) -> None:
    with pytest.raises((PortUnusableError, PortAbsentError)):
        open_port(url, 9600)


def test_loop_of_pyserial_opens_though_it_has_nothing_to_poll() -> None:
    port = open_port("loop://", 9600)
    wait_connected(port)
    port.close()

"""The port: opens a device so that nothing is disturbed, and reads what is there.

A device path (a serial port, a USB serial adapter, a pty) is opened here with termios; a URL (``socket://host:port``,
``rfc2217://``, whatever pyserial's ``serial_for_url`` opens) by pyserial in a thread of its own, since connecting may
take seconds and some of its ports have nothing to poll. Both give a `Port`: a file descriptor to poll, `read`, `close`.

Why not pyserial for paths: it asserts DTR and RTS at every open and leaves HUPCL set, so that the kernel drops DTR at
close. An Arduino takes the edge of DTR as its reset. Here the modem lines are never touched and HUPCL is cleared at
once: DTR then stays asserted when the port is closed, also when the process is killed, and no later open makes an
edge. (The kernel itself asserts DTR at the first open after plugging in: the board has only just started then.)
"""

from __future__ import annotations

import errno
import fcntl
import os
import struct
import termios
from typing import TYPE_CHECKING, Protocol

from acquisition.port_error import (
    READ_SIZE,
    PortAbsentError,
    PortBusyError,
    PortDeniedError,
    PortError,
    PortLostError,
    PortUnusableError,
)

if TYPE_CHECKING:
    from acquisition.url_port import UrlPort

_PTY_MAJORS = range(136, 144)  # Unix98 pty slaves
_ABSENT_ERRORS = frozenset({errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.EIO, errno.ENOTDIR, errno.ELOOP})

# The kernel's struct termios2, for speeds that have no B constant: the same numbers on x86, Arm and RISC-V.
_TCGETS2 = 0x802C542A
_TCSETS2 = 0x402C542B
_BOTHER = 0o010000
_CBAUD = 0o010017
_TERMIOS2 = struct.Struct("4I20s2I")


class Port(Protocol):
    """An open port."""

    def fileno(self) -> int:
        """The file descriptor to poll for input."""

    def read(self, size: int = READ_SIZE) -> bytes:
        """What is there, at most `size` bytes; b"" when there is nothing now. Raises PortError when it is lost."""

    def close(self) -> None:
        """Give the device back; harmless when repeated."""

    @property
    def connected(self) -> bool:
        """Whether the far end is there yet: True at once for a device path."""


def open_port(name: str, baud: int) -> Port:
    """The port of a device path or URL at `baud` bits per second, 8N1, held exclusively; PortError when it cannot be.

    Never blocks: a URL that is not connected yet raises its PortError from `read`.
    """
    if "://" in name:
        return _open_url(name, baud)
    return DevicePort(name, baud)


def _open_url(name: str, baud: int) -> UrlPort:
    from acquisition.url_port import UrlPort  # pyserial, sockets and threads: only where a URL asks for them

    return UrlPort(name, baud)


class DevicePort:
    """A tty of this machine."""

    __slots__ = ("_fd", "name")

    connected = True

    def __init__(self, path: str, baud: int) -> None:
        self.name = path
        self._fd = -1
        try:
            self._fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            _lock(self._fd)
            _configure(self._fd, baud)
            termios.tcflush(self._fd, termios.TCIFLUSH)  # older bytes would be stamped as if they came now
        except (OSError, termios.error) as error:  # termios.error is no OSError, but has the same arguments
            self.close()
            raise _open_error(path, baud, error) from None

    def fileno(self) -> int:
        return self._fd

    def read(self, size: int = READ_SIZE) -> bytes:
        try:
            chunk = os.read(self._fd, size)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise PortLostError(error.errno, f"{self.name} vanished ({os.strerror(error.errno or 0)})") from None
        if not chunk:  # VMIN is 1: an empty read is a hang-up, never "nothing yet"
            raise PortLostError(errno.EIO, f"{self.name} vanished (hung up)")
        return chunk

    def close(self) -> None:
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1


def _lock(fd: int) -> None:
    """Keep other programs off: flock for those that ask (pyserial, picocom), TIOCEXCL for those that do not.

    A pty keeps TIOCEXCL as long as its master lives, beyond the death of the process that set it, and would lock its
    next reader out; a serial port forgets it at its last close.
    """
    fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    if os.major(os.fstat(fd).st_rdev) not in _PTY_MAJORS:
        fcntl.ioctl(fd, termios.TIOCEXCL)


def _configure(fd: int, baud: int) -> None:
    """Raw 8N1 without flow control; DTR stays as it is, at close too."""
    iflag, oflag, cflag, lflag, _, _, cc = termios.tcgetattr(fd)
    iflag &= ~(
        termios.IGNBRK
        | termios.BRKINT
        | termios.PARMRK
        | termios.INPCK
        | termios.ISTRIP
        | termios.INLCR
        | termios.IGNCR
        | termios.ICRNL
        | termios.IXON
        | termios.IXOFF
        | termios.IXANY
    )
    oflag &= ~termios.OPOST
    lflag &= ~(termios.ECHO | termios.ECHONL | termios.ICANON | termios.ISIG | termios.IEXTEN)
    cflag &= ~(termios.CSIZE | termios.PARENB | termios.CSTOPB | termios.CRTSCTS | termios.HUPCL)
    cflag |= termios.CS8 | termios.CREAD | termios.CLOCAL
    cc[termios.VMIN], cc[termios.VTIME] = 1, 0
    speed = getattr(termios, f"B{baud}", None)
    known = speed if speed is not None else termios.B38400
    termios.tcsetattr(fd, termios.TCSANOW, [iflag, oflag, cflag, lflag, known, known, cc])
    if speed is None:
        iflag, oflag, cflag, lflag, line_cc, _, _ = _TERMIOS2.unpack(fcntl.ioctl(fd, _TCGETS2, bytes(_TERMIOS2.size)))
        cflag = cflag & ~_CBAUD | _BOTHER
        fcntl.ioctl(fd, _TCSETS2, _TERMIOS2.pack(iflag, oflag, cflag, lflag, line_cc, baud, baud))


def _open_error(path: str, baud: int, error: OSError | termios.error) -> PortError:
    """The typed error of a failed open."""
    number: int = error.args[0]
    reason = os.strerror(number)
    if number in (errno.EACCES, errno.EPERM):
        return PortDeniedError(number, f"{path} may not be opened ({reason}); join the group that owns it (dialout)")
    if number in (errno.EBUSY, errno.EWOULDBLOCK):
        return PortBusyError(number, f"{path} is held by another program; end it (fuser {path} names it)")
    if number in _ABSENT_ERRORS:
        return PortAbsentError(number, f"{path} is not there ({reason})")
    if number == errno.ENOTTY:
        return PortUnusableError(number, f"{path} is no serial device")
    return PortUnusableError(number, f"{path} cannot be opened at {baud} baud ({reason})")

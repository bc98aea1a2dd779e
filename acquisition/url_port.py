"""A port behind a URL, opened by pyserial: a receiver on the network, or one of pyserial's own adapters.

Connecting may take seconds, and some of pyserial's ports (``rfc2217://``) have no file descriptor. A thread therefore
connects, waits for bytes and passes them on through a pipe, which the worker polls like any device.
"""

from __future__ import annotations

import errno
import os
import select
import threading

import serial

from acquisition.port_error import READ_SIZE, PortAbsentError, PortError, PortLostError, PortUnusableError

_READ_TIMEOUT_S = 1.0  # how soon the thread sees that the port was closed, where there is nothing to poll


class UrlPort:
    """The bytes of whatever pyserial's ``serial_for_url`` opens."""

    def __init__(self, url: str, baud: int) -> None:
        self.name = url
        self._error: PortError | None = None
        self._connected = False
        self._closing = False
        try:
            # do_not_open: here only the URL is judged; a wrong one is the config's fault, not the network's.
            self._serial = serial.serial_for_url(url, do_not_open=True, baudrate=baud, timeout=_READ_TIMEOUT_S)
        except (ValueError, serial.SerialException) as error:
            raise PortUnusableError(errno.EINVAL, f"{url} is no URL that pyserial opens ({error})") from None
        self._fd, self._far_fd = os.pipe()
        os.set_blocking(self._fd, False)
        self._thread = threading.Thread(target=self._pump, name=f"port {url}", daemon=True)
        self._thread.start()

    @property
    def connected(self) -> bool:
        return self._connected

    def fileno(self) -> int:
        return self._fd

    def read(self, size: int = READ_SIZE) -> bytes:
        try:
            chunk = os.read(self._fd, size)
        except BlockingIOError:
            return b""
        if not chunk:
            raise self._error or PortLostError(errno.EIO, f"{self.name} was closed")
        return chunk

    def close(self) -> None:
        """Stop reading. The thread may still be connecting: it closes the port itself as soon as it can."""
        self._closing = True
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    def _pump(self) -> None:
        """In the thread: connect, then pass on what comes until the port or its reader goes."""
        try:
            self._serial.open()
        except (OSError, ValueError) as error:  # SerialException is an OSError
            self._error = PortAbsentError(errno.ECONNREFUSED, f"{self.name} does not answer ({error})")
            os.close(self._far_fd)
            return
        self._connected = True
        try:
            self._pass_on()
        except BrokenPipeError:
            pass  # closed by its reader
        except OSError as error:
            self._error = PortLostError(errno.ECONNRESET, f"{self.name} vanished ({error})")
        finally:
            os.close(self._far_fd)
            self._serial.close()

    def _pass_on(self) -> None:
        waiting = self._poll()
        while not self._closing:
            if waiting is None:
                chunk = self._serial.read(max(1, self._serial.in_waiting))
            else:
                chunk = self._serial.read(READ_SIZE) if waiting.poll(_READ_TIMEOUT_S * 1000) else b""
            if chunk:
                os.write(self._far_fd, chunk)

    def _poll(self) -> select.poll | None:
        """What to wait with; where there is no descriptor, pyserial's own time-out waits instead."""
        try:
            fd = self._serial.fileno()
        except OSError:  # io.UnsupportedOperation is one
            return None
        self._serial.timeout = 0.0
        waiting = select.poll()
        waiting.register(fd, select.POLLIN)
        return waiting

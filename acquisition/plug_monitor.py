"""The plug monitor: udev says at once when a serial device was plugged in, before anybody looks.

Where no udev runs (a container, a pty) there is no monitor, and workers look once a second.
"""

from __future__ import annotations

import logging
import os

UDEV_CONTROL = "/run/udev/control"  #: there while a udev daemon runs

_log = logging.getLogger(__name__)


class PlugMonitor:
    """Tells of serial devices that were added or renamed, after udev has made their links."""

    def __init__(self) -> None:
        """OSError or ImportError where udev cannot be listened to."""
        import pyudev  # five workers live without it

        self._monitor = pyudev.Monitor.from_netlink(pyudev.Context(), source="udev")
        self._monitor.filter_by("tty")
        self._monitor.start()

    def fileno(self) -> int:
        """Readable when there is something to take."""
        return int(self._monitor.fileno())

    def take(self) -> list[str]:
        """The device nodes plugged in since the last call; never waits."""
        nodes = []
        while (device := self._monitor.poll(timeout=0)) is not None:
            if device.action != "remove" and device.device_node:
                nodes.append(device.device_node)
        return nodes

    def close(self) -> None:
        """Listen no more."""
        del self._monitor  # closes its socket


def open_plug_monitor() -> PlugMonitor | None:
    """The monitor, or None where there is no udev."""
    if not os.path.exists(UDEV_CONTROL):
        return None
    try:
        return PlugMonitor()
    except (OSError, ImportError) as error:
        _log.info("udev cannot be listened to (%s): missing devices are looked for once a second", error)
        return None

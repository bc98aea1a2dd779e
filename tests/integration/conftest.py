"""Real ptys for the workers to read, and waiting for what they do."""

from __future__ import annotations

import os
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

DEADLINE_S = 15.0


class PtyDevice:
    """A device that can be unplugged: a pty behind a link of a constant name, as udev makes it."""

    def __init__(self, link: Path) -> None:
        self.link = link
        self.path = str(link)
        self._master = -1
        self.plug()

    def plug(self) -> None:
        """Appear, under whatever name the kernel gives."""
        self._master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(self._master, False)
        new = self.link.with_suffix(".new")
        new.symlink_to(os.ttyname(slave))
        new.rename(self.link)
        os.close(slave)

    def unplug(self) -> None:
        """Vanish, with the link."""
        if self._master >= 0:
            os.close(self._master)
            self._master = -1
            self.link.unlink()

    def write(self, chunk: bytes) -> int:
        """Send; how many bytes the pty took: a reader that stopped reading makes it less."""
        try:
            return os.write(self._master, chunk)
        except BlockingIOError:
            return 0


@pytest.fixture
def new_device(tmp_path: Path) -> Iterator[Callable[[str], PtyDevice]]:
    """Makes a device of a name."""
    devices: list[PtyDevice] = []

    def make(name: str) -> PtyDevice:
        devices.append(PtyDevice(tmp_path / name))
        return devices[-1]

    yield make
    for device in devices:
        device.unplug()


@pytest.fixture
def wait_for() -> Callable[[Callable[[], object], str], None]:
    """Repeats a step (which itself waits a little) until it gives something true; fails at the deadline."""

    def wait(step: Callable[[], object], what: str) -> None:
        end = time.monotonic() + DEADLINE_S
        while not step():
            assert time.monotonic() < end, f"{what}: not within {DEADLINE_S:.0f} s"

    return wait

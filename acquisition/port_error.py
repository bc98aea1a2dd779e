"""What can be wrong with a port, and how much is read from one: shared by the ports of devices and of URLs."""

from __future__ import annotations

from acquisition.message import ABSENT, BUSY, DENIED, LOST, UNUSABLE

READ_SIZE = 4096  #: bytes asked for in one read: the line discipline's buffer


class PortError(OSError):
    """A port that cannot be opened or read; `state` is what a PORT message says of it."""

    state = ABSENT


class PortAbsentError(PortError):
    """No such device, or nobody answers at that address. It may be plugged in later."""


class PortDeniedError(PortError):
    """The device is there, this user may not open it."""

    state = DENIED


class PortBusyError(PortError):
    """Another program holds the device."""

    state = BUSY


class PortLostError(PortError):
    """The device was open and vanished: unplugged, hung up, or its far end closed."""

    state = LOST


class PortUnusableError(PortError):
    """What is there is no serial device, or does not take the settings."""

    state = UNUSABLE

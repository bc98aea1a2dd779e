"""umockdev's testbed: devices that come and go, with udev's events, for what runs under `umockdev-wrapper`."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping

from usb_tree import Usb, describe


class _GError(ctypes.Structure):
    _fields_ = (("domain", ctypes.c_uint32), ("code", ctypes.c_int), ("message", ctypes.c_char_p))


class Testbed:
    """An empty /sys to which devices are added."""

    __test__ = False  # no test class

    def __init__(self) -> None:
        self._library = ctypes.CDLL("libumockdev.so.0")
        for name in ("new", "add_from_string", "uevent", "remove_device"):
            getattr(self._library, f"umockdev_testbed_{name}").restype = ctypes.c_void_p
        self._testbed = ctypes.c_void_p(self._library.umockdev_testbed_new())

    def add(self, tree: Mapping[str, Usb], *, hubs: bool = True) -> None:
        """Plug devices in, with the hubs they need or, where these are there already, without; udev tells."""
        text = describe(tree) if hubs else describe(tree).split("\n\n")[-1]
        error = ctypes.POINTER(_GError)()
        done = self._library.umockdev_testbed_add_from_string(self._testbed, text.encode(), ctypes.byref(error))
        assert done, error.contents.message

    def event(self, usb: Usb, action: str) -> None:
        """Let udev tell of a device."""
        self._library.umockdev_testbed_uevent(self._testbed, f"/sys{usb.sys_path}".encode(), action.encode())

    def remove(self, usb: Usb) -> None:
        """Take a device away, without a word."""
        self._library.umockdev_testbed_remove_device(self._testbed, f"/sys{usb.sys_path}".encode())

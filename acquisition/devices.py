"""Serial devices as udev knows them: what is plugged in where, and which sensor it probably is.

Read with libudev (pyudev); no port is opened here. `device_rules` makes udev rules of it, `device_probe` listens.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import pyudev

GPS, COMPASS, IMU = "gps", "compass", "imu"

#: Kinds by USB vendor and product ("" is any): the reference devices and their relatives.
KNOWN_IDS = {
    ("1546", ""): GPS,  # u-blox
    ("2341", ""): COMPASS,  # Arduino, which prints what the compass module says
    ("2a03", ""): COMPASS,  # Arduino of the other vendor
    ("10c4", "ea60"): IMU,  # CP210x, the EBIMU's receiver
}


@dataclass(frozen=True, slots=True)
class SerialDevice:
    """A serial port; texts exactly as the kernel gives them, empty where the device has none."""

    node: str  #: the kernel's name of the moment: /dev/ttyACM0
    subsystem: str  #: of what it hangs on: usb, platform, ...
    port_path: str = ""  #: KERNELS of the USB device: 1-1.1.2; the same after replugging into the same socket
    vendor_id: str = ""
    product_id: str = ""
    product: str = ""
    serial: str = ""
    interface: str = ""  #: of a device with several ports: which one
    links: tuple[str, ...] = ()  #: of udev, below /dev

    @property
    def identity(self) -> tuple[str, str, str, str]:
        """What the device says of itself, wherever it is plugged in."""
        return self.vendor_id, self.product_id, self.serial, self.interface

    @property
    def kind(self) -> str:
        """gps, compass or imu by its USB ids; empty when they tell nothing."""
        return KNOWN_IDS.get((self.vendor_id, self.product_id)) or KNOWN_IDS.get((self.vendor_id, ""), "")


def list_serial_devices(context: pyudev.Context | None = None) -> list[SerialDevice]:
    """The serial devices of this machine, by the port they are plugged into."""
    found = [
        _serial_device(device)
        for device in (context or pyudev.Context()).list_devices(subsystem="tty")
        if device.device_node and _is_real(device)
    ]
    return sorted(found, key=lambda device: (device.subsystem != "usb", port_order(device.port_path), device.node))


def port_order(port_path: str) -> tuple[int, ...]:
    """A key that sorts 1-1.9 before 1-1.10."""
    return tuple(int(number) for number in port_path.replace("-", ".").split(".") if number.isdigit())


def _is_real(device: pyudev.Device) -> bool:
    """Whether it is hardware: a console has no parent, and a UART that is not there is of type 0."""
    parent = device.parent
    if parent is None:
        return False
    return parent.subsystem == "usb" or _attribute(device, "type") not in ("", "0") or _usb_device(device) is not None


def _usb_device(device: pyudev.Device) -> pyudev.Device | None:
    return device.find_parent("usb", "usb_device")


def _serial_device(device: pyudev.Device) -> SerialDevice:
    links = tuple(sorted(device.device_links))
    usb = _usb_device(device)
    if usb is None:
        return SerialDevice(device.device_node, device.parent.subsystem or "", links=links)
    interface = device.find_parent("usb", "usb_interface")
    return SerialDevice(
        node=device.device_node,
        subsystem="usb",
        port_path=usb.sys_name,
        vendor_id=_attribute(usb, "idVendor"),
        product_id=_attribute(usb, "idProduct"),
        product=_attribute(usb, "product"),
        serial=_attribute(usb, "serial"),
        interface=_attribute(interface, "bInterfaceNumber") if interface is not None else "",
        links=links,
    )


def _attribute(device: pyudev.Device, name: str) -> str:
    """A sysfs attribute, its spaces kept; empty when there is none."""
    value = device.attributes.get(name)
    return value.decode("utf-8", "replace") if value is not None else ""


def guess_roles(devices: Sequence[SerialDevice], kinds: dict[str, str] | None = None) -> dict[str, SerialDevice]:
    """Which device is gps1, gps2, ..., compass, imu: by `kinds` (node to kind) or the USB ids.

    Receivers are numbered in the order of their ports. Of two compasses or IMUs none is chosen.
    """
    roles: dict[str, SerialDevice] = {}
    of_kind: dict[str, list[SerialDevice]] = {}
    for device in devices:
        kind = kinds.get(device.node, "") if kinds is not None else device.kind
        of_kind.setdefault(kind, []).append(device)
    for number, device in enumerate(of_kind.get(GPS, []), 1):
        roles[f"gps{number}"] = device
    for kind in (COMPASS, IMU):
        if len(of_kind.get(kind, [])) == 1:
            roles[kind] = of_kind[kind][0]
    return roles

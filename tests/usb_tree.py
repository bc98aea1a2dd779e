"""USB devices as umockdev takes them: a BeagleBone's port 1-1, a powered hub, a second hub behind it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

ROOT_PATH = "/devices/platform/ocp/musb-hdrc.1/usb1"


class Usb(NamedTuple):
    """A USB device with a serial port."""

    port: str  #: 1-1.1.2
    node: str  #: ttyACM0
    vendor: str
    product_id: str
    product: str
    serial: str = ""
    interface: str = "00"

    @property
    def sys_path(self) -> str:
        """The device path of its tty."""
        return f"{usb_path(self.port)}/{self.port}:1.{int(self.interface)}/tty/{self.node}"


GPS = ("1546", "01a5", "u-blox 5 - GPS Receiver")
#: The papers' boat.
PAPERS = {
    "imu": Usb("1-1.1.1", "ttyUSB0", "10c4", "ea60", "CP2102 USB to UART Bridge Controller", "0001"),
    "gps1": Usb("1-1.1.2", "ttyACM0", *GPS),
    "gps2": Usb("1-1.1.3", "ttyACM1", *GPS),
    "gps3": Usb("1-1.1.4", "ttyACM2", *GPS),
    "compass": Usb("1-1.4", "ttyACM3", "2a03", "0043", "Arduino Uno", "85439303033351819221"),
}


def usb_path(port: str) -> str:
    """The device path of a USB port."""
    _, *numbers = port.split(".")
    path, name = f"{ROOT_PATH}/1-1", "1-1"
    for number in numbers:
        name += f".{number}"
        path += f"/{name}"
    return path


def describe(devices: Mapping[str, Usb]) -> str:
    """The umockdev description of the hubs and these devices."""
    ports = {usb.port for usb in devices.values()}
    hubs = {port.rsplit(".", count)[0] for port in ports for count in range(1, port.count(".") + 1)} - ports
    blocks = [_usb_device(hub, "1a40", "0101", "USB 2.0 Hub", "") for hub in sorted(hubs)]
    for port in sorted(ports):
        usb = next(usb for usb in devices.values() if usb.port == port)
        blocks.append(_usb_device(port, usb.vendor, usb.product_id, usb.product, usb.serial))
    for number, usb in enumerate(devices.values()):
        blocks.append(
            f"P: {usb_path(usb.port)}/{usb.port}:1.{int(usb.interface)}\n"
            "E: SUBSYSTEM=usb\nE: DEVTYPE=usb_interface\n"
            f"A: bInterfaceNumber={usb.interface}\n"
        )
        blocks.append(
            f"P: {usb.sys_path}\nN: {usb.node}\nE: SUBSYSTEM=tty\nE: DEVNAME=/dev/{usb.node}\n"
            f"E: MAJOR=166\nE: MINOR={number}\nA: dev=166:{number}\n"
        )
    return "\n".join(blocks)


def _usb_device(port: str, vendor: str, product_id: str, product: str, serial: str) -> str:
    product = product.replace("\\", "\\\\")
    text = f"P: {usb_path(port)}\nE: SUBSYSTEM=usb\nE: DEVTYPE=usb_device\nE: PRODUCT={vendor}/{product_id}/100\n"
    text += f"A: idVendor={vendor}\nA: idProduct={product_id}\n"
    text += f"A: product={product}\n" if product else ""
    return text + (f"A: serial={serial}\n" if serial else "")

"""udev rules that give each sensor a name of its own, in the form of the papers.

The IMU is known by vendor, product and serial number; compass and receivers also by the port they are plugged into,
since three equal receivers differ in nothing else. The rules keep off ModemManager, which probes every new port.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from acquisition.devices import SerialDevice

RULES_FILE = Path("/etc/udev/rules.d/70-tinyekf.rules")
RULES_FOLDERS = ("/etc/udev/rules.d", "/run/udev/rules.d", "/usr/lib/udev/rules.d", "/lib/udev/rules.d")

_LINK_NAME = re.compile(r"[A-Za-z0-9_.+-]+(/[A-Za-z0-9_.+-]+)*")


class RuleError(ValueError):
    """A rule that cannot be written: one line saying which and why."""


def match_text(value: str) -> str:
    r"""`value` as the pattern of a rule that matches it alone, quoted.

    udev matches with the shell's patterns: `*?[` are put into brackets, the backslash is doubled; of the alternatives
    that `|` would separate, and of a character that no pattern can name, any single character is let pass.
    """
    pattern = "".join(_pattern_of(character) for character in value)
    return f'"{pattern}"'


def _pattern_of(character: str) -> str:
    if character in "*?[":
        return f"[{character}]"
    if character == "\\":
        return "\\\\"
    if character == "|" or not character.isprintable() or character == "\ufffd":
        return "?"
    return '\\"' if character == '"' else character


def rule(link: str, role: str, device: SerialDevice, others: Iterable[SerialDevice]) -> str:
    """The rule, one line, that links /dev/`link` to `device`, of the sensor `role`; `others` are those plugged in too.

    RuleError for a name that udev would not take.
    """
    if not _LINK_NAME.fullmatch(link) or ".." in link:
        raise RuleError(f"{link!r} cannot be the name of a link: give letters, digits, and _ . + -, as fjGPS1")
    others = [other for other in others if other.node != device.node]
    matches = ['SUBSYSTEM=="tty"']
    if device.subsystem != "usb":
        matches.append(f"KERNEL=={match_text(Path(device.node).name)}")
    else:
        alone = role == "imu" and device.serial and all(other.identity != device.identity for other in others)
        if not alone:
            matches.append(f"KERNELS=={match_text(device.port_path)}")
        matches.append(f"ATTRS{{idVendor}}=={match_text(device.vendor_id)}")
        matches.append(f"ATTRS{{idProduct}}=={match_text(device.product_id)}")
        if device.product and not alone:
            matches.append(f"ATTRS{{product}}=={match_text(device.product)}")
        if device.serial:
            matches.append(f"ATTRS{{serial}}=={match_text(device.serial)}")
        if any(other.port_path == device.port_path for other in others):
            matches.append(f"ENV{{ID_USB_INTERFACE_NUM}}=={match_text(device.interface)}")
    return ", ".join([*matches, f'SYMLINK+="{link}"', 'ENV{ID_MM_DEVICE_IGNORE}="1"'])


def rules_text(roles: Mapping[str, SerialDevice], links: Mapping[str, str], plugged: Sequence[SerialDevice]) -> str:
    """The rules file for `roles` (sensor to device), whose links are named by `links` (sensor to name below /dev)."""
    if len({links[role] for role in roles}) < len(roles):
        raise RuleError("two sensors cannot have one link; give each its own port in the configuration")
    lines = ["# Names of the sensors of tinyekf, written by `tinyekf devices rules`.", ""]
    for role, device in roles.items():
        where = f"port {device.port_path}" if device.port_path else device.node
        lines += [f"# {role}: {device.product.strip() or 'a serial device'} at {where}"]
        lines += [rule(links[role], role, device, plugged)]
    return "\n".join(lines) + "\n"


def gpsd_rules(device: SerialDevice, folders: Sequence[str] = RULES_FOLDERS) -> list[Path]:
    """The rules files by which gpsd claims `device` when it is plugged in."""
    vendor, product = (f'"{text}"' for text in (device.vendor_id, device.product_id))
    found: dict[str, Path] = {}  # a file hides those of its name in later folders
    for folder in map(Path, folders):
        for path in sorted(folder.glob("*.rules")) if folder.is_dir() else ():
            found.setdefault(path.name, path)
    return [
        path
        for path in found.values()
        if any(
            "gpsd" in line and vendor in line and product in line and not line.lstrip().startswith("#")
            for line in path.read_text("utf-8", "replace").replace("\\\n", " ").splitlines()
        )
    ]

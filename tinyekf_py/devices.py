"""`tinyekf devices`: find the sensors, give them lasting names, check that the names are right.

Exit status: 0 done and all well, 1 something is missing or failed, 2 the command line is wrong.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from acquisition.device_probe import probe
from acquisition.device_rules import RULES_FILE, RuleError, gpsd_rules, rules_text
from acquisition.devices import SerialDevice, guess_roles, list_serial_devices
from acquisition.port_error import PortError
from tinyekf_py.command_line import OneLineParser, complain
from tinyekf_py.config import Config, ConfigError, load_config

LOOK_PERIOD_S = 0.2
REPLUG_PATIENCE_S = 120.0
COLUMNS = ("DEVICE", "SUBSYSTEM", "KERNELS", "VENDOR", "PRODUCT", "ROLE", "SERIAL", "NAME", "LINKS")


Look = Callable[[], list[SerialDevice]]


class DevicesError(RuntimeError):
    """Something that cannot be done: one line saying what and what to do."""


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(prog="tinyekf devices", description="Find the sensors and give them lasting names.")
    commands = parser.add_subparsers(dest="command", required=True, parser_class=OneLineParser)
    config = OneLineParser(add_help=False)
    config.add_argument("--config", type=Path, metavar="FILE", help="configuration that names the links")
    config.add_argument("--probe", action="store_true", help="open the ports and listen who speaks")
    commands.add_parser("list", parents=[config], help="every serial device, and which sensor it probably is")
    rules = commands.add_parser("rules", parents=[config], help="write udev rules for them")
    rules.add_argument("--role", action="append", default=[], metavar="NAME=DEVICE", help="as gps1=/dev/ttyACM0")
    rules.add_argument("--assign", action="store_true", help="find out by unplugging and replugging each")
    target = rules.add_mutually_exclusive_group()
    target.add_argument("--output", type=Path, metavar="FILE", help="default: standard output")
    target.add_argument("--install", action="store_true", help=f"write {RULES_FILE} and let udev read it")
    commands.add_parser("check", parents=[config], help="whether each configured name leads to the right device")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; the exit status."""
    options = _parser().parse_args(argv)
    try:
        config = load_config(options.config) if options.config else Config()
        devices = list_serial_devices()
        if options.command == "list":
            return _list(devices, probing=options.probe)
        if options.command == "rules":
            return _rules(options, config, devices)
        return _check(config, devices, probing=options.probe)
    except (ConfigError, RuleError) as error:
        return complain("devices", error)
    except (DevicesError, OSError) as error:
        return complain("devices", error, 1)


def _heard(device: str) -> str:
    """The kind that speaks at a port, or why that is not known."""
    try:
        kind, baud = probe(device)
    except PortError as error:
        return f"? {error.strerror}"
    return f"{kind} at {baud}" if kind else "? silent or unknown"


def _list(devices: Sequence[SerialDevice], *, probing: bool) -> int:
    rows = [COLUMNS]
    for device in devices:
        role = _heard(device.node) if probing else f"{device.kind}?" if device.kind else "-"
        ids = (device.subsystem, device.port_path or "-", device.vendor_id or "-", device.product_id or "-")
        links = " ".join(link for link in device.links if not link.startswith("/dev/serial/"))
        rows.append((device.node, *ids, role, device.serial or "-", repr(device.product), links or "-"))
    widths = [max(len(row[column]) for row in rows) for column in range(len(COLUMNS))]
    for row in rows:
        print("  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip())
    if not devices:
        print("(no serial device is plugged in)")
    return 0


def _links(config: Config) -> dict[str, str]:
    """The name below /dev of each sensor whose port is one."""
    ports = {name: config.sensors[name].port for name in config.sources}
    return {name: port.removeprefix("/dev/") for name, port in ports.items() if port.startswith("/dev/")}


def _rules(options: argparse.Namespace, config: Config, devices: Sequence[SerialDevice]) -> int:
    links = _links(config)
    if options.assign:
        roles = assign(list(links), list_serial_devices, lambda text: print(text, file=sys.stderr, flush=True))
        devices = list_serial_devices()
    elif options.role:
        roles = _named_roles(options.role, links, devices)
    else:
        kinds = {device.node: _heard(device.node).partition(" ")[0] for device in devices} if options.probe else None
        roles = guess_roles(devices, kinds)
        roles = {name: roles[name] for name in links if name in roles}
    for name in links:
        if name not in roles:
            print(f"# {name}: not found; plug it in, or name it: --role {name}=/dev/ttyACM0", file=sys.stderr)
    if not roles:
        raise DevicesError("no sensor was found; tinyekf devices list shows what is plugged in")
    text = rules_text(roles, links, devices)
    if options.install:
        _install(text)
        print(f"{RULES_FILE} is written; tinyekf devices check tells whether the names are there", file=sys.stderr)
    elif options.output:
        options.output.write_text(text, "utf-8")
    else:
        print(text, end="")
    return 0


def _install(rules: str) -> None:
    """Write the rules where udev reads them, and let it read them and go through the devices that are there."""
    try:
        RULES_FILE.write_text(rules, "utf-8")
    except OSError as error:
        raise DevicesError(f"cannot write {RULES_FILE}: {error.strerror}") from error
    for arguments in (["control", "--reload"], ["trigger", "--subsystem-match=tty", "--action=add"]):
        command = f"udevadm {arguments[0]}"
        try:
            done = subprocess.run(["udevadm", *arguments], check=False, capture_output=True, text=True)
        except OSError as error:
            raise DevicesError(f"{RULES_FILE} is written, but not read: {command}: {error.strerror}") from error
        if done.returncode:
            said = (done.stderr.strip() or f"exit status {done.returncode}").splitlines()[-1]
            raise DevicesError(f"{RULES_FILE} is written, but not read: {command}: {said}; is udev running?")


def _named_roles(
    named: Sequence[str], links: dict[str, str], devices: Sequence[SerialDevice]
) -> dict[str, SerialDevice]:
    roles = {}
    for assignment in named:
        name, _, node = assignment.partition("=")
        if name not in links:
            raise RuleError(
                f"--role {assignment}: no sensor {name!r} with a port below /dev; there are {', '.join(links)}"
            )
        found = [device for device in devices if os.path.realpath(node) == device.node or node == device.port_path]
        if len(found) != 1:
            raise RuleError(f"--role {assignment}: no device {node!r}; tinyekf devices list shows what is plugged in")
        roles[name] = found[0]
    return roles


def assign(names: Sequence[str], look: Look, say: Callable[[str], None]) -> dict[str, SerialDevice]:
    """Ask for each sensor to be unplugged and replugged; which device each is. DevicesError when nothing happens."""
    roles = {}
    for name in names:
        before = look()
        say(f"Unplug {name} ...")
        gone = _missing_from(before, look, name)
        say(f"... {gone[0].node} is gone. Plug it in again, where it shall stay ...")
        come = _added_to([device for device in before if device not in gone], look, name)
        say(f"... {name} is {come[0].node} at port {come[0].port_path or '-'}")
        roles[name] = come[0]
    return roles


def _missing_from(before: list[SerialDevice], look: Look, name: str) -> list[SerialDevice]:
    def gone() -> list[SerialDevice]:
        here = {device.node for device in look()}
        return [device for device in before if device.node not in here]

    return _until(gone, name)


def _added_to(before: list[SerialDevice], look: Look, name: str) -> list[SerialDevice]:
    known = {device.node for device in before}
    return _until(lambda: [device for device in look() if device.node not in known], name)


def _until(found: Callable[[], list[SerialDevice]], name: str) -> list[SerialDevice]:
    end = time.monotonic() + REPLUG_PATIENCE_S
    while not (devices := found()):
        if time.monotonic() > end:
            raise DevicesError(f"{name}: nothing was unplugged or plugged in for {REPLUG_PATIENCE_S:.0f} s")
        time.sleep(LOOK_PERIOD_S)
    return devices


def _check(config: Config, devices: Sequence[SerialDevice], *, probing: bool) -> int:
    well = True
    for name in config.sources:
        port = config.sensors[name].port
        verdict, fine = _verdict(name, port, devices, probing=probing)
        well &= fine
        print(f"{name:8} {port}: {verdict}")
    for device in devices:
        for path in gpsd_rules(device):
            well = False
            what = f"{device.node} ({device.vendor_id}:{device.product_id})"
            print(f"warning: {path} lets gpsd take {what}; systemctl mask gpsdctl@.service, or remove gpsd")
    return 0 if well else 1


def _verdict(name: str, port: str, devices: Sequence[SerialDevice], *, probing: bool) -> tuple[str, bool]:
    """What there is to say of a sensor's port, and whether it is well."""
    wanted = name.rstrip("0123456789")
    if "://" in port:
        return "not a device of this machine; nothing to check", True
    if not port.startswith("/") and not os.path.lexists(port):
        return f"missing in {os.getcwd()}, where a name without a / in front is looked for; say /dev/{port}", False
    if not os.path.lexists(port):
        return "missing; plug it in, and if it is: tinyekf devices rules --install", False
    target = os.path.realpath(port)
    if not os.path.exists(target):
        return f"leads to {target}, which is not there; replug the device", False
    device = next((device for device in devices if device.node == target), None)
    if device is not None and device.kind not in ("", wanted) and not probing:
        return f"leads to {target}, which looks like {device.kind}; --probe listens", False
    if probing:
        heard = _heard(port)
        if heard.partition(" ")[0] != wanted:
            return f"leads to {target}, where the answer is: {heard}; expected {wanted}", False
        return f"leads to {target}; {heard} answers", True
    return f"leads to {target}; --probe tells who answers", True


if __name__ == "__main__":
    sys.exit(main())

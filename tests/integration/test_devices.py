"""Persistent names on real libudev and real rules: a tree of USB devices made by umockdev, the papers' and worse."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from live_boat import DEADLINE_S, ROOT, Boat
from usb_tree import GPS, PAPERS, Usb, describe

from acquisition.device_probe import kind_of, probe
from acquisition.device_rules import RuleError, gpsd_rules, match_text, rule, rules_text
from acquisition.devices import SerialDevice, guess_roles, port_order
from tinyekf_py.devices import assign
from tinyekf_py.devices import main as devices

LINKS = {"gps1": "fjGPS1", "gps2": "fjGPS2", "gps3": "fjGPS3", "compass": "fjEC", "imu": "fjIMU"}

#: Runs udev's rules over each device; in a mount namespace whose /dev and rules are its own, since links are made.
UDEV_TEST = """
set -e
mount -t tmpfs none /run
mkdir -p /run/dev /run/rules /run/udev
for node in null zero urandom; do touch /run/dev/$node; mount --bind /dev/$node /run/dev/$node; done
ln -s pts/ptmx /run/dev/ptmx
mkdir /run/dev/pts; mount --rbind /dev/pts /run/dev/pts
cp "$1"/*.rules /run/rules/
mkdir -p /etc/udev/rules.d
mount --bind /run/rules /etc/udev/rules.d
mount --rbind /run/dev /dev
tree="$2"; shift 2
for path in "$@"; do umockdev-run -d "$tree" -- udevadm test --action=add "/sys$path" 2>&1; done
"""


def need(*programs: str) -> None:
    missing = [program for program in programs if shutil.which(program) is None]
    if missing and os.environ.get("CI"):
        pytest.fail(f"{missing[0]} is not installed")
    if missing:
        pytest.skip(f"{missing[0]} is not installed")


def need_namespaces(*options: str) -> None:
    if subprocess.run(["unshare", *options, "true"], capture_output=True).returncode:
        if os.environ.get("CI"):
            pytest.fail("no namespaces: run the tests as root")
        pytest.skip("no namespaces: udev is tested as root")


def tinyekf_devices(tmp_path: Path, tree: dict[str, Usb], *words: str) -> subprocess.CompletedProcess[str]:
    """The command on a machine with these devices."""
    need("umockdev-run")
    (tmp_path / "tree").write_text(describe(tree))
    command = ["umockdev-run", "-d", str(tmp_path / "tree"), "--", sys.executable, "-m", "tinyekf_py.devices", *words]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=DEADLINE_S)


def written_rules(tmp_path: Path, tree: dict[str, Usb], *words: str) -> str:
    done = tinyekf_devices(tmp_path, tree, "rules", *words)
    assert done.returncode == 0, done.stderr
    return done.stdout


def links_given(tmp_path: Path, rules: str, tree: dict[str, Usb]) -> dict[str, set[str]]:
    """The links that udev itself gives each device of `tree` under `rules`, by the device's name in it."""
    need("umockdev-run", "udevadm", "unshare")
    need_namespaces("-m")
    folder = tmp_path / "rules"
    folder.mkdir(exist_ok=True)
    (folder / "70-tinyekf.rules").write_text(rules)
    (tmp_path / "tree").write_text(describe(tree))
    paths = [usb.sys_path for usb in tree.values()]
    command = ["unshare", "-m", "sh", "-c", UDEV_TEST, "sh", str(folder), str(tmp_path / "tree"), *paths]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr
    links: dict[str, set[str]] = {}
    for report in done.stdout.split("DEVPATH=")[1:]:
        path, *lines = report.splitlines()
        name = next(name for name, usb in tree.items() if usb.sys_path == path)
        given_links = next((line.removeprefix("DEVLINKS=") for line in lines if line.startswith("DEVLINKS=")), "")
        # udev's own, and those of gpsd's rules where it is installed, are not ours.
        links[name] = {link for link in given_links.split() if not re.match(r"/dev/(serial/|gps\d)", link)}
        if links[name]:
            assert "ID_MM_DEVICE_IGNORE=1" in lines
    return links


def test_the_list_shows_what_a_rule_needs(tmp_path: Path) -> None:
    shown = tinyekf_devices(tmp_path, PAPERS, "list").stdout.splitlines()
    assert [line.split()[:6] for line in shown[1:]] == [
        ["/dev/ttyUSB0", "usb", "1-1.1.1", "10c4", "ea60", "imu?"],
        ["/dev/ttyACM0", "usb", "1-1.1.2", "1546", "01a5", "gps?"],
        ["/dev/ttyACM1", "usb", "1-1.1.3", "1546", "01a5", "gps?"],
        ["/dev/ttyACM2", "usb", "1-1.1.4", "1546", "01a5", "gps?"],
        ["/dev/ttyACM3", "usb", "1-1.4", "2a03", "0043", "compass?"],
    ]
    assert "85439303033351819221" in shown[5]


def test_the_papers_boat_gets_the_papers_names(tmp_path: Path) -> None:
    rules = written_rules(tmp_path, PAPERS)
    assert 'KERNELS=="1-1.1.1"' not in rules  # the IMU is known wherever it is plugged in
    assert links_given(tmp_path, rules, PAPERS) == {name: {f"/dev/{link}"} for name, link in LINKS.items()}


def test_names_stay_under_other_kernel_names_and_go_with_the_port(tmp_path: Path) -> None:
    rules = written_rules(tmp_path, PAPERS)
    later = PAPERS | {
        "gps1": PAPERS["gps1"]._replace(node="ttyACM7"),  # removed and added again
        "gps2": PAPERS["gps2"]._replace(port="1-1.1.4"),  # the cables of two equal receivers swapped
        "gps3": PAPERS["gps3"]._replace(port="1-1.1.3"),
        "imu": PAPERS["imu"]._replace(port="1-1.2", node="ttyUSB4"),
    }
    assert links_given(tmp_path, rules, later) == {
        "gps1": {"/dev/fjGPS1"},
        "gps2": {"/dev/fjGPS3"},
        "gps3": {"/dev/fjGPS2"},
        "compass": {"/dev/fjEC"},
        "imu": {"/dev/fjIMU"},
    }


#: Installs rules where a udev daemon runs ($2 is "yes") or none does; all in namespaces of its own.
INSTALL = """
set -e
mount -t tmpfs none /run
mkdir -p /run/udev /run/rules /etc/udev/rules.d
mount --bind /run/rules /etc/udev/rules.d
if [ "$2" = yes ]; then /lib/systemd/systemd-udevd --daemon; udevadm control --ping; fi
umockdev-run -d "$1" -- "$3" -m tinyekf_py.devices rules --install && status=0 || status=$?
cat /etc/udev/rules.d/70-tinyekf.rules
if [ "$2" = yes ]; then udevadm control --ping; udevadm control --exit; fi
exit $status
"""


@pytest.mark.parametrize("daemon", ["yes", "no"])
def test_rules_are_installed_and_udev_reads_them(tmp_path: Path, daemon: str) -> None:
    need("umockdev-run", "udevadm", "unshare", "/lib/systemd/systemd-udevd")
    need_namespaces("-m", "-p", "--fork")
    (tmp_path / "tree").write_text(describe(PAPERS))
    command = ["unshare", "-m", "-p", "--fork", "--mount-proc", "sh", "-c", INSTALL, "sh", str(tmp_path / "tree")]
    done = subprocess.run(
        [*command, daemon, sys.executable], capture_output=True, text=True, cwd=ROOT, timeout=DEADLINE_S
    )
    assert 'SYMLINK+="fjGPS3"' in done.stdout
    said = [line for line in done.stderr.splitlines() if "systemd-udevd" not in line]
    assert len(said) == 1, done.stderr
    if daemon == "yes":
        assert done.returncode == 0, done.stderr
        assert "is written; tinyekf devices check" in said[0]
    else:
        assert done.returncode == 1
        assert "is written, but not read: udevadm control" in said[0]


def test_of_two_equal_serial_numbers_the_port_decides(tmp_path: Path) -> None:
    tree = {"imu": PAPERS["imu"], "other": PAPERS["imu"]._replace(port="1-1.2", node="ttyUSB1")}
    assert "imu: not found" in tinyekf_devices(tmp_path, tree, "rules").stderr  # which of them, nobody can tell
    rules = written_rules(tmp_path, tree, "--role", "imu=1-1.1.1")
    assert links_given(tmp_path, rules, tree) == {"imu": {"/dev/fjIMU"}, "other": set()}


def test_texts_are_kept_to_the_space_and_quoted(tmp_path: Path) -> None:
    strange = 'A "strange"  device*[1]?\\x $HOME %k '
    tree = {
        "compass": Usb("1-1.4", "ttyACM3", "2a03", "0043", strange, "1"),
        "other": Usb("1-1.4", "ttyACM4", "2a03", "0043", strange.replace("*", "Z"), "1"),
    }
    device = SerialDevice("/dev/ttyACM3", "usb", "1-1.4", "2a03", "0043", strange, "1")
    rules = rule("fjEC", "compass", device, []) + "\n"
    assert links_given(tmp_path, rules, {"compass": tree["compass"]}) == {"compass": {"/dev/fjEC"}}
    assert links_given(tmp_path, rules, {"other": tree["other"]}) == {"other": set()}


def test_ports_of_one_device_are_told_apart(tmp_path: Path) -> None:
    devices = [SerialDevice(f"/dev/ttyUSB{n}", "usb", "1-1.2", "0403", "6011", "Quad", "", f"0{n}") for n in range(4)]
    text = rules_text({"gps1": devices[0], "gps2": devices[2]}, LINKS, devices)
    assert 'ENV{ID_USB_INTERFACE_NUM}=="00"' in text
    assert 'ENV{ID_USB_INTERFACE_NUM}=="02"' in text


@given(st.text(st.characters(min_codepoint=32, max_codepoint=0x24F), max_size=40))
def test_no_text_breaks_out_of_its_quotes(text: str) -> None:
    quoted = match_text(text)
    inside = quoted[1:-1].replace('\\"', "")
    assert '"' not in inside
    assert quoted[0] == quoted[-1] == '"'
    assert "\n" not in quoted


@pytest.mark.parametrize("link", ["", "../sda", 'x", RUN+="rm', "a b", "/etc"])
def test_a_link_of_another_form_is_refused(link: str) -> None:
    with pytest.raises(RuleError, match="cannot be the name of a link"):
        rule(link, "imu", SerialDevice("/dev/ttyUSB0", "usb", "1-1", "10c4", "ea60"), [])


def test_receivers_are_numbered_by_their_ports() -> None:
    ports = ["1-1.10", "1-1.9", "1-1.1.2"]
    devices = [SerialDevice(f"/dev/{n}", "usb", port, *GPS) for n, port in enumerate(ports)]
    roles = guess_roles(sorted(devices, key=lambda device: port_order(device.port_path)))
    assert [roles[f"gps{n}"].port_path for n in (1, 2, 3)] == ["1-1.1.2", "1-1.9", "1-1.10"]


def test_assignment_by_unplugging_and_replugging() -> None:
    receiver = SerialDevice("/dev/ttyACM0", "usb", "1-1.1.2", *GPS)
    other = SerialDevice("/dev/ttyACM1", "usb", "1-1.1.3", *GPS)
    moved = SerialDevice("/dev/ttyACM0", "usb", "1-1.1.4", *GPS)
    looks = iter([[receiver, other], [other], [other, moved], [other, moved], [moved], [other, moved]])
    said: list[str] = []
    roles = assign(["gps1", "gps2"], lambda: next(looks), said.append)
    assert roles == {"gps1": moved, "gps2": other}
    assert said[0] == "Unplug gps1 ..."


def test_check_says_what_is_missing_and_what_to_do(tmp_path: Path) -> None:
    done = tinyekf_devices(tmp_path, PAPERS, "check")
    assert done.returncode == 1
    assert "/dev/fjGPS1: missing; plug it in" in done.stdout


def test_check_takes_a_port_without_a_folder_for_what_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "here").symlink_to("/dev/null")
    ports = {"gps1": "ttyACM0", "gps2": "here", "gps3": "socket://boat:2000"}
    (tmp_path / "boat.toml").write_text("".join(f'[sensors.{name}]\nport = "{port}"\n' for name, port in ports.items()))
    assert devices(["check", "--config", "boat.toml"]) == 1
    said = capsys.readouterr().out
    assert (
        f"gps1     ttyACM0: missing in {tmp_path}, where a name without a / in front is looked for; say /dev/ttyACM0"
        in said
    )
    assert "gps2     here: leads to /dev/null" in said
    assert "gps3     socket://boat:2000: not a device of this machine" in said


def test_gpsds_claim_on_the_papers_receiver_is_seen(tmp_path: Path) -> None:
    claim = (
        'ATTRS{idVendor}=="1546", ATTRS{idProduct}=="01a5", SYMLINK+="gps%n", \\\n'
        'TAG+="systemd", ENV{SYSTEMD_WANTS}="gpsdctl@%k.service"\n'
    )
    (tmp_path / "60-gpsd.rules").write_text(claim)
    receiver = SerialDevice("/dev/ttyACM0", "usb", "1-1.1.2", *GPS)
    assert gpsd_rules(receiver, [str(tmp_path)]) == [tmp_path / "60-gpsd.rules"]
    assert gpsd_rules(SerialDevice("/dev/x", "usb", "1-1", "2a03", "0043"), [str(tmp_path)]) == []
    (tmp_path / "60-gpsd.rules").write_text(f"# {claim}")
    assert gpsd_rules(receiver, [str(tmp_path)]) == []


@pytest.fixture
def boat(tmp_path: Path) -> Iterator[Boat]:
    boat = Boat(tmp_path)
    yield boat
    boat.close()


def test_each_device_is_known_by_what_it_says_and_check_tells_a_swapped_cable(tmp_path: Path, boat: Boat) -> None:
    kinds = {name: probe(str(cable.link), [9600])[0] for name, cable in boat.cables.items()}
    assert kinds == {"gps1": "gps", "gps2": "gps", "gps3": "gps", "compass": "compass", "imu": "imu"}
    config = tmp_path / "config.toml"
    cables = boat.cables | {"compass": boat.cables["imu"]}
    config.write_text("".join(f'[sensors.{name}]\nport = "{cable.link}"\n' for name, cable in cables.items()))
    done = tinyekf_devices(tmp_path, PAPERS, "check", "--probe", "--config", str(config))
    assert done.returncode == 1
    assert [line.split()[0] for line in done.stdout.splitlines() if "answers" in line] == [
        "gps1",
        "gps2",
        "gps3",
        "imu",
    ]
    assert "where the answer is: imu at" in done.stdout


def test_noise_and_silence_are_no_device() -> None:
    assert kind_of(b"") == ""
    assert kind_of(bytes(range(256)) * 20) == ""
    assert kind_of(b"$GPGGA,garbage\r\n" * 5) == ""


#: Under umockdev: a device is plugged in, pulled out, plugged in under another name.
MONITOR = """
import select, sys
sys.path.insert(0, "tests")
from umockdev_testbed import Testbed
from usb_tree import PAPERS
from acquisition.devices import list_serial_devices
from acquisition.plug_monitor import PlugMonitor
bed, tree = Testbed(), {"gps1": PAPERS["gps1"]}
monitor = PlugMonitor()
assert monitor.take() == []
bed.add(tree)
assert select.select([monitor], [], [], 10)[0], "no event"
taken = monitor.take()
assert taken == ["/dev/ttyACM0"], taken
assert [device.node for device in list_serial_devices()] == ["/dev/ttyACM0"]
bed.event(tree["gps1"], "remove")
assert select.select([monitor], [], [], 10)[0], "no event"
assert monitor.take() == []
bed.remove(tree["gps1"])
assert list_serial_devices() == []
bed.add({"gps1": tree["gps1"]._replace(node="ttyACM5")}, hubs=False)
assert select.select([monitor], [], [], 10)[0], "no event"
assert monitor.take() == ["/dev/ttyACM5"]
found = list_serial_devices()
assert [(device.node, device.port_path) for device in found] == [("/dev/ttyACM5", "1-1.1.2")]
print("well")
"""

#: Under umockdev: a worker that would look for its device once an hour opens it as soon as udev tells of it.
WOKEN = """
import json, os, sys, time, tty
from pathlib import Path
sys.path.insert(0, "tests")
from umockdev_testbed import Testbed
from usb_tree import PAPERS
from acquisition import port_watch
if len(sys.argv) > 3:  # the worker
    from acquisition.worker import main
    port_watch.RETRY_US = 3_600_000_000
    sys.exit(main(sys.argv[2:]))
import subprocess
from acquisition import supervisor as supervision
from acquisition.device import DeviceSettings
from acquisition.plug_monitor import PlugMonitor
from acquisition.supervisor import Supervisor
from acquisition.worker_process import WorkerProcess
link = Path(sys.argv[1])
class Patient(WorkerProcess):
    def _start(self, settings, start_us, polling, out_fd, control_fd):
        told = {"name": settings.name, "port": settings.port, "driver": settings.driver, "baud": settings.baud}
        told |= {"options": {}, "polling": polling, "start_us": start_us, "parent_pid": os.getpid()}
        command = [sys.executable, "-c", os.environ["WOKEN"], "worker", str(out_fd), str(control_fd), json.dumps(told)]
        return subprocess.Popen(command, pass_fds=(out_fd, control_fd))
supervision.WorkerProcess = Patient
bed, monitor = Testbed(), PlugMonitor()
supervisor = Supervisor([DeviceSettings("gps1", str(link), "nmea", 9600)], time.monotonic_ns() // 1000, monitor)
def until(state):
    end = time.monotonic() + 20
    while supervisor.states["gps1"].port_state != state:
        assert time.monotonic() < end, supervisor.states
        supervisor.poll(0.1)
until("absent")
master, slave = os.openpty()
tty.setraw(slave)
link.symlink_to(os.ttyname(slave))
plugged = time.monotonic()
bed.add({"gps1": PAPERS["gps1"]})
until("open")
print(f"open {1000 * (time.monotonic() - plugged):.0f} ms after the event", file=sys.stderr)
fd = monitor.fileno()
supervisor.close()
try:
    os.fstat(fd)
    sys.exit("the monitor is still open")
except OSError:
    print("well")
"""


@pytest.mark.parametrize("script", [MONITOR, WOKEN], ids=["monitor", "worker"])
def test_what_udev_tells_is_heard_at_once(script: str, tmp_path: Path) -> None:
    need("umockdev-wrapper")
    command = ["umockdev-wrapper", sys.executable, "-c", script, str(tmp_path / "fjGPS1")]
    environment = {**os.environ, "WOKEN": WOKEN}
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env=environment, timeout=60)
    assert done.stdout == "well\n", done.stderr[-2000:]

"""Starts the installed service as systemd would, in a root where no systemd runs; run on the board, as root.

The unit's ExecStart is run as its User with its runtime and state folders, and a socket of ours hears what it would
tell systemd: ready, the watchdog's feed, the end.
"""

from __future__ import annotations

import grp
import os
import pwd
import shlex
import shutil
import socket
import stat
import subprocess
import sys
from configparser import ConfigParser
from pathlib import Path

UNIT = Path("/lib/systemd/system/tinyekf.service")
NOTIFY_SOCKET = "/run/systemd-notify"
PATIENCE_S = 120.0


def main() -> int:
    unit = ConfigParser(strict=False, interpolation=None)
    unit.optionxform = str  # type: ignore[assignment, method-assign]
    unit.read_string(UNIT.read_text("utf-8"))
    service = unit["Service"]
    user = pwd.getpwnam(service["User"])
    group = grp.getgrnam(service["Group"])
    supplementary = [grp.getgrnam(name).gr_gid for name in service["SupplementaryGroups"].split()]
    assert user.pw_gid == group.gr_gid, "the user's own group"
    assert user.pw_name in grp.getgrnam("dialout").gr_mem, "the user is in dialout"
    runtime, state = Path("/run", service["RuntimeDirectory"]), Path("/var/lib", service["StateDirectory"])
    for folder in (runtime, state):
        folder.mkdir(exist_ok=True)
        shutil.chown(folder, user.pw_uid, group.gr_gid)

    manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    manager.bind(NOTIFY_SOCKET)
    os.chmod(NOTIFY_SOCKET, 0o666)
    manager.settimeout(PATIENCE_S)
    process = subprocess.Popen(
        shlex.split(service["ExecStart"]),
        user=user.pw_uid,
        group=group.gr_gid,
        extra_groups=supplementary,
        umask=int(service["UMask"], 8),
        cwd=service["WorkingDirectory"],
        stdout=subprocess.DEVNULL,
        env={
            "PATH": "/usr/bin:/bin",
            "NOTIFY_SOCKET": NOTIFY_SOCKET,
            "WATCHDOG_USEC": str(int(service["WatchdogSec"]) * 1_000_000),
            "RUNTIME_DIRECTORY": str(runtime),
            "STATE_DIRECTORY": str(state),
        },
    )
    try:
        assert manager.recv(4096) == b"READY=1"
        fed = manager.recv(4096)
        assert fed.startswith(b"WATCHDOG=1\nSTATUS="), fed
        control = (runtime / "ctl.sock").stat()
        assert stat.S_IMODE(control.st_mode) == 0o660, oct(control.st_mode)
        assert control.st_gid == group.gr_gid
        answer = subprocess.run(["tinyekf", "ctl", "status"], capture_output=True, text=True, check=False)
        assert answer.returncode == 0, answer.stderr
        assert "gps1" in answer.stdout
        process.terminate()
        while (last := manager.recv(4096)) != b"STOPPING=1":
            assert last.startswith(b"WATCHDOG=1"), last
        assert process.wait(PATIENCE_S) == 0
    finally:
        process.kill()
    recordings = sorted(state.glob("heading.rec*"))
    assert recordings, f"no recording in {state}"
    print(f"service: ready, watchdog fed ({fed.partition(b'STATUS=')[2].decode()}), stopped; {recordings[0]} recorded")
    return 0


if __name__ == "__main__":
    sys.exit(main())

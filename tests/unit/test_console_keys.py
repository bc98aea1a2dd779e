"""Keys of the console: whose terminal they are taken from."""

from __future__ import annotations

import os
import pty
import subprocess
import sys

import pytest

PROGRAM = """
import queue
from tinyekf_py.console_keys import ConsoleKeys
keys = queue.SimpleQueue()
with ConsoleKeys(keys.put):
    print("ready", flush=True)
    try:
        print(keys.get(timeout=float({patience})), flush=True)
    except queue.Empty:
        print("none", flush=True)
"""


@pytest.mark.parametrize(("patience", "own", "heard"), [(30, True, "g"), (0, False, "none")])
def test_keys_come_from_the_sessions_own_terminal_alone(patience: int, own: bool, heard: str) -> None:
    ours, theirs = pty.openpty()
    take_terminal = "import fcntl, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0)\n" if own else ""
    program = subprocess.Popen(
        [sys.executable, "-c", take_terminal + PROGRAM.format(patience=patience)],
        stdin=theirs,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    os.close(theirs)
    assert program.stdout is not None
    assert program.stdout.readline() == "ready\n"
    os.write(ours, b"g")
    assert program.stdout.readline() == f"{heard}\n"
    program.communicate()
    os.close(ours)
    assert program.returncode == 0

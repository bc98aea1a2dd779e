"""Interpreters of our own beside the main program: how one is started, and how it ends with its parent."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import subprocess

_PACKAGE_PARENT = str(Path(__file__).resolve().parent.parent)
_PR_SET_PDEATHSIG = 1


def start_module(module: str, arguments: Sequence[str], fds: Sequence[int]) -> subprocess.Popen[bytes]:
    """Start `python -m MODULE ARGUMENTS`, which inherits the descriptors `fds`. OSError when the system cannot."""
    import subprocess  # which a child, small as it is, does not need

    # -P and PYTHONPATH: the same package as here, wherever the program was started.
    paths = [_PACKAGE_PARENT, *filter(None, [os.environ.get("PYTHONPATH")])]
    return subprocess.Popen(
        [sys.executable, "-P", "-m", module, *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        pass_fds=fds,
        process_group=0,  # Ctrl-C at the terminal is for the parent alone
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
    )


def end_with_parent(parent_pid: int) -> None:
    """Be killed when the parent dies, even while stopped or stuck in a device driver."""
    import ctypes

    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent_pid:  # it died before the request
        sys.exit(0)

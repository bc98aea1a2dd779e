"""A quiet end of any command. It imports nothing that Python has not loaded anyway: Ctrl-C may come at once."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable

CTRL_C_STATUS = 130  # as of a program that SIGINT ended


def ended_quietly(command: Callable[[], int]) -> int:
    """The exit status of `command`; Ctrl-C ends it without a word, and so does whoever closes its output."""
    try:
        try:
            return command()
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for what is left to flush
        return 0
    except KeyboardInterrupt:
        return CTRL_C_STATUS

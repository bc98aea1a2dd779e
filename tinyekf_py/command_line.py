"""What the command lines share: a parser that complains in one line, and the exit status of a complaint."""

from __future__ import annotations

import argparse
import math
import sys
from typing import NoReturn


class OneLineParser(argparse.ArgumentParser):
    """An argument parser whose errors are one line on stderr, without the usage, and exit status 2."""

    def error(self, message: str) -> NoReturn:
        print(f"{self.prog}: {message}", file=sys.stderr)
        sys.exit(2)


def complain(command: str, error: Exception | str, status: int = 2) -> int:
    """Say what is wrong in one line; the exit status for it. A closed output is nothing wrong, and raised again."""
    if isinstance(error, BrokenPipeError):
        raise error
    print(f"tinyekf {command}: {error}", file=sys.stderr)
    return status


def positive_seconds(text: str) -> float:
    """Seconds of an option; must be above 0."""
    value = float(text)
    if not (math.isfinite(value) and value > 0.0):
        raise argparse.ArgumentTypeError(f"give seconds above 0, not {text}")
    return value

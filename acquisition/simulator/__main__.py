"""Entry point of `python -m acquisition.simulator`."""

from __future__ import annotations

import sys

from acquisition.simulator.command import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

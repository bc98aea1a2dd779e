"""Entry point of `python -m tinyekf_py.calibrate`."""

from __future__ import annotations

import sys

from tinyekf_py.calibrate.command import main

if __name__ == "__main__":
    sys.exit(main())

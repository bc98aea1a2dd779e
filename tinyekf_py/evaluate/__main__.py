"""Entry point of `python -m tinyekf_py.evaluate`."""

from __future__ import annotations

import sys

from tinyekf_py.evaluate.command import main

if __name__ == "__main__":
    sys.exit(main())

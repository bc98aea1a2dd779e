"""The output process is a small one: none of its outputs needs NumPy or the C core."""

from __future__ import annotations

import subprocess
import sys

from tinyekf_py.outputs.process import MODULES


def test_no_output_imports_numpy_or_the_core() -> None:
    program = (
        "import importlib, sys\n"
        f"for name in {[*MODULES.values(), 'tinyekf_py.outputs.process']!r}: importlib.import_module(name)\n"
        "print([name for name in ('numpy', 'tinyekf_py._core') if name in sys.modules])\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == "[]\n"

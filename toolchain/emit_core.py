"""Writes what a cross compiler needs of the core's extension module: its C, and the compiler's arguments.

    python toolchain/emit_core.py CORE.c FLAGS

cffi writes the C on this machine from the headers, as $CC -E leaves them; FLAGS gets one argument a line. Run in the
project's folder, or a copy of it.
"""

from __future__ import annotations

import runpy
import sys
from pathlib import Path


def main() -> None:
    core, flags = sys.argv[1:]
    build = runpy.run_path("tinyekf_py/_core_build.py")
    build["ffibuilder"].emit_c_code(core)
    Path(flags).write_text("\n".join(build["COMPILE_ARGS"]) + "\n", "utf-8")


if __name__ == "__main__":
    main()

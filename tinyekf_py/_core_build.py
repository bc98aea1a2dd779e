"""Builds `tinyekf_py._core`, the C core as an extension module (cffi, out-of-line API mode, abi3).

The declarations are those of the headers themselves, as the C preprocessor leaves them: what Python sees cannot
drift from what C has. Run by setup.py; the sources are in `csrc/`. `TINYEKF_REAL=float` in the environment builds the
filters in single precision (bench/board/README.md says why the default is better).
"""

from __future__ import annotations

import os
import shlex
import subprocess
import sysconfig
from pathlib import Path

from cffi import FFI

ROOT = Path(__file__).resolve().parent.parent
CSRC = Path(os.path.relpath(ROOT / "csrc"))
HEADERS = ("angle.h", "local_frame.h", "cnw.h", "covariance_intersection.h", "fusion.h", "vehicle.h")
SOURCES = sorted(str(path) for path in CSRC.glob("*.c"))
#: Precision of the filters.
REAL = os.environ.get("TINYEKF_REAL") or "double"
if REAL not in ("double", "float"):
    raise SystemExit(f"TINYEKF_REAL is {REAL}; it can be double or float")
#: -ffp-contract=off: a fused multiply-add would give other last digits on one board than on another.
COMPILE_ARGS = ["-std=c11", "-O2", "-ffp-contract=off", f"-DEKF_REAL={REAL}"]


def declarations() -> str:
    """The core's declarations as cffi's cdef takes them."""
    compiler = shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc")
    includes = "".join(f'#include "{header}"\n' for header in HEADERS)
    command = [*compiler, "-E", "-P", "-DTINYEKF_CDEF", f"-DEKF_REAL={REAL}", "-I", str(ROOT / "csrc"), "-x", "c", "-"]
    return subprocess.run(command, input=includes, capture_output=True, text=True, check=True).stdout


ffibuilder = FFI()
ffibuilder.cdef(declarations())
ffibuilder.set_source(
    "tinyekf_py._core",
    "".join(f'#include "{header}"\n' for header in HEADERS),
    sources=SOURCES,
    include_dirs=[str(CSRC)],
    extra_compile_args=COMPILE_ARGS,
    libraries=["m"],
    py_limited_api=True,
)

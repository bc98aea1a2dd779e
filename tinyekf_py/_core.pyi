"""The C core as cffi gives it; its declarations are those of `csrc/`."""

from typing import Any

ffi: Any
lib: Any

"""Writing values as TOML: what `--print-config` and the `#config` lines of a recording are made of.

Python reads TOML (`tomllib`) but does not write it; the few types of a configuration are all that is needed here.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence


def toml_value(value: object) -> str:
    """`value` (str, bool, int, float or a sequence of these) as the right side of a TOML `key = value`."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str):
        # A JSON string is a TOML basic string but for DEL, which TOML wants escaped.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Sequence) and not isinstance(value, bytes | bytearray | Mapping):
        return "[" + ", ".join(toml_value(item) for item in value) + "]"
    raise TypeError(f"a configuration cannot hold {value!r} of type {type(value).__name__}")

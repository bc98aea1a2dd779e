"""Puts one value into a configuration file and leaves everything else in it, comments and all, as it was."""

from __future__ import annotations

import os
import re
import tomllib
from pathlib import Path
from typing import Any

from acquisition.toml_value import toml_value
from tinyekf_py.config import Config, ConfigError, apply_flat, load_config

_HEADER = re.compile(r"^\s*\[")


def set_key(path: Path, dotted: str, value: object) -> None:
    """Set `dotted` (as sensors.compass.deviation) in the TOML file `path`, which is made if it is not there.

    The file is replaced in one step, after the new text was read back. ConfigError when the value is not allowed, or
    when the file is written in a way that cannot be edited line by line.
    """
    apply_flat(Config(), {dotted: value}, "the calibration")  # says what is wrong with the value
    before: dict[str, Any] = {}
    text = ""
    if path.exists():
        load_config(path)
        text = path.read_text("utf-8")
        before = tomllib.loads(text)
    table, _, key = dotted.rpartition(".")
    edited = _edited(text, table, f"{key} = {toml_value(value)}", key)
    wanted = before
    for name in table.split("."):
        wanted = wanted.setdefault(name, {})
    wanted[key] = list(value) if isinstance(value, tuple) else value
    try:
        matches = tomllib.loads(edited) == before
    except tomllib.TOMLDecodeError:
        matches = False
    if not matches:
        raise ConfigError(
            f"{path} is written in a way that cannot be edited; set {dotted} = {toml_value(value)} by hand"
        )
    new = path.with_name(f"{path.name}.new")
    try:
        new.write_text(edited, "utf-8")
        os.replace(new, path)
    except OSError as error:
        raise ConfigError(f"cannot write configuration {path}: {error.strerror or error}") from error


def _edited(text: str, table: str, line: str, key: str) -> str:
    lines = text.splitlines()
    header = re.compile(rf"^\s*\[\s*{re.escape(table)}\s*\]\s*(#.*)?$")
    start = next((i for i, old in enumerate(lines) if header.match(old)), None)
    if start is None:
        return "\n".join([*lines, *([""] if lines else []), f"[{table}]", line]) + "\n"
    end = next((i for i in range(start + 1, len(lines)) if _HEADER.match(lines[i])), len(lines))
    same = re.compile(rf"^\s*{re.escape(key)}\s*=")
    for i in range(start + 1, end):
        if same.match(lines[i]):
            lines[i] = line
            break
    else:
        lines.insert(start + 1, line)
    return "\n".join(lines) + "\n"

"""The keys of the configuration as declarations: default, unit, one sentence of documentation, and what is allowed.

A section of the configuration is a frozen dataclass whose fields are made by `key`. From these declarations alone
`config` checks a file, documents it (`--print-config`), and knows which keys shape the result and so belong in a
recording.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from acquisition.toml_value import toml_value

#: From a TOML value to the value of the field; ValueError says what is expected, as in "must be a number".
Check = Callable[[object], object]


class ConfigError(ValueError):
    """A configuration that is wrong: one line saying which key of which file, and what is allowed."""


@dataclass(frozen=True, slots=True)
class Key:
    """What is declared of a key beside its default."""

    doc: str  #: one sentence
    unit: str  #: empty where the value has none
    check: Check
    shapes_result: bool  #: whether a replay needs it to give the numbers of the live run


def key(default: Any, doc: str, check: Check, *, unit: str = "", shapes_result: bool = False) -> Any:
    """A field of a section's dataclass that is a key of the configuration."""
    return dataclasses.field(default=default, metadata={"key": Key(doc, unit, check, shapes_result)})


def table(default: Any, name: str = "") -> Any:
    """A field of a section's dataclass that is a section within it; `name` where TOML's is not the field's."""
    return dataclasses.field(default=default, metadata={"table": name})


def tables_of(section: object) -> dict[str, str]:
    """The sections within a section (its dataclass or a value of it): TOML's name -> the field's name."""
    fields = dataclasses.fields(section)  # type: ignore[arg-type]
    return {field.metadata["table"] or field.name: field.name for field in fields if "table" in field.metadata}


def keys_of(section: object) -> dict[str, Key]:
    """The declared keys of a section (its dataclass or a value of it), by name, in order."""
    fields = dataclasses.fields(section)  # type: ignore[arg-type]
    return {field.name: field.metadata["key"] for field in fields if "key" in field.metadata}


def boolean(value: object) -> bool:
    if not isinstance(value, bool):
        raise ValueError("must be true or false")
    return value


def text(value: object) -> str:
    if not isinstance(value, str):
        raise ValueError("must be a text in quotes")
    if "\0" in value:  # which no path and no address can hold
        raise ValueError("must not hold a NUL character")
    return value


def nonempty_text(value: object) -> str:
    if not isinstance(value, str) or not value.strip():
        raise ValueError("must be a text in quotes, and not empty")
    return text(value)


def integer(lowest: int, highest: int) -> Check:
    def check(value: object) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not lowest <= value <= highest:
            raise ValueError(f"must be a whole number from {lowest} to {highest}")
        return value

    return check


def number(lowest: float, highest: float, *, or_word: str = "") -> Check:
    """A finite number in [lowest, highest], or the word `or_word` where one is given."""
    allowed = f"a number from {lowest:g} to {highest:g}" + (f' or "{or_word}"' if or_word else "")

    def check(value: object) -> float | str:
        if or_word and value == or_word:
            return or_word
        if not _is_number(value) or not lowest <= value <= highest:  # type: ignore[operator]
            raise ValueError(f"must be {allowed}")
        return float(value)  # type: ignore[arg-type]

    return check


def numbers(names: Sequence[str], lowest: float, highest: float) -> Check:
    """A list of finite numbers in [lowest, highest], one for each of `names`."""

    def check(value: object) -> tuple[float, ...]:
        if (
            not isinstance(value, list | tuple)
            or len(value) != len(names)
            or not all(_is_number(item) and lowest <= item <= highest for item in value)
        ):
            raise ValueError(f"must be {len(names)} numbers [{', '.join(names)}] from {lowest:g} to {highest:g}")
        return tuple(float(item) for item in value)

    return check


def places(most: int, reach_m: float) -> Check:
    """A list of up to `most` places [ahead, to starboard], each number at most `reach_m` either way."""
    one = numbers(("ahead", "to starboard"), -reach_m, reach_m)

    def check(value: object) -> tuple[object, ...]:
        if not isinstance(value, list | tuple) or len(value) > most:
            raise ValueError(f"must be a list of at most {most} places [ahead, to starboard]")
        return tuple(one(item) for item in value)

    return check


def choice(*words: str) -> Check:
    def check(value: object) -> str:
        if not isinstance(value, str):
            raise ValueError(f"must be one of {', '.join(toml_value(word) for word in words)}")
        if value not in words:
            nearest = toml_value(nearest_of(value, words))
            raise ValueError(f"does not exist; did you mean {nearest}? There is {', '.join(words)}")
        return value

    return check


def words(*allowed: str) -> Check:
    """A list of words, each one of `allowed`."""
    one = choice(*allowed)

    def check(value: object) -> tuple[str, ...]:
        if not isinstance(value, list | tuple):
            raise ValueError("must be a list of texts in quotes")
        return tuple(str(one(item)) for item in value)

    return check


def texts(value: object) -> tuple[str, ...]:
    """A list of texts, none of them empty."""
    if not isinstance(value, list | tuple):
        raise ValueError("must be a list of texts in quotes")
    return tuple(nonempty_text(item) for item in value)


def nearest_of(word: str, words: Iterable[str]) -> str:
    """The one of `words` that looks most like `word`, however little that is."""
    known = list(words)
    return get_close_matches(word, known, 1, cutoff=0.0)[0] if known else ""


def _is_number(value: object) -> bool:
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer of more than 308 digits
        return False

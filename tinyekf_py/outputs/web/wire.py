"""The view state as JSON: the names of its fields, null for what is not known.

`/api/state` and the page's stream give the same object; docs/web.md describes it.
"""

from __future__ import annotations

import json
import time
from math import isfinite
from typing import Any

from tinyekf_py.estimate import DECIMALS, decimals_of
from tinyekf_py.outputs.feed import Feed
from tinyekf_py.view_state import MAX_ESTIMATE_AGE_S, ViewState

#: Fields in which a negative number means that it is not known.
_COUNTS = frozenset({"fix_quality", "satellites"})


def state_object(feed: Feed) -> dict[str, Any]:
    """The newest view state, its estimate as it may be given out now, and what every page has to say of it."""
    state = feed.state or ViewState(None)
    plain = _plain(state._replace(estimate=feed.estimate))
    assert isinstance(plain, dict)
    plain["estimate_age_s"] = number(state.estimate_age_s + feed.age_s if state.estimate else float("inf"), 3)
    plain["sigma_is_calibrated"] = state.method == "adaptive"
    plain["alarms"] = _plain(feed.alarms)
    plain["sent_s"] = round(time.monotonic(), 3)  # on this machine's monotonic clock: what comes late shows by it
    # A program that no longer speaks: what it said last of its sensors is not how they are.
    plain["is_stale"] = not feed.age_s <= MAX_ESTIMATE_AGE_S
    return plain


def to_json(value: object) -> str:
    """Strict JSON in ASCII; `value` has no NaN."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False)


def number(value: float, decimals: int = DECIMALS) -> float | None:
    """`value` rounded, None when it is not finite."""
    return round(value, decimals) if isfinite(value) else None


def _plain(value: Any) -> Any:
    """Named tuples as objects, other tuples as lists, what is not known as None."""
    names = _names(type(value))
    if names:
        return {name: _field(name, decimals, item) for (name, decimals), item in zip(names, value, strict=True)}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return number(value) if isinstance(value, float) else value


def _field(name: str, decimals: int, value: Any) -> Any:
    if type(value) is float:
        return number(value, decimals)
    if type(value) not in _LEAVES:
        return _plain(value)
    return None if name in _COUNTS and value < 0 else value


_LEAVES = (int, str, bool)
_FIELDS: dict[type, tuple[tuple[str, int], ...]] = {}


def _names(kind: type) -> tuple[tuple[str, int], ...]:
    """A named tuple's fields with their decimals; none of another type."""
    if kind not in _FIELDS:
        _FIELDS[kind] = tuple((name, decimals_of(name)) for name in getattr(kind, "_fields", ()))
    return _FIELDS[kind]

"""Signal K messages: what the outputs say of a view state in that format (specification 1.7).

Values are in SI and radians, positions in degrees; what is not known, or too old, is null. Pure functions: `signalk`
sends what they give over TCP and UDP, the web server over WebSocket.
"""

from __future__ import annotations

import hmac
import json
import uuid
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from functools import cache
from math import isfinite, radians
from pathlib import Path
from typing import Any

from tinyekf_py.alarms import Alarm
from tinyekf_py.estimate import Estimate
from tinyekf_py.view_state import Navigation, ViewState, current_estimate, current_navigation

VERSION = "1.7.0"
#: The context of deltas that a Signal K server is to take for its own vessel's.
SELF = "vessels.self"
SOURCE, SIMULATED_SOURCE = "tinyekf", "tinyekf.simulated"
HEADING_NOTIFICATION = "notifications.navigation.headingTrue"

#: GGA's fix quality -> navigation.gnss.methodQuality.
_METHOD_QUALITY = {
    2: "DGNSS fix", 3: "Precise GNSS", 4: "RTK fixed integer", 5: "RTK float", 6: "Estimated (DR) mode",
    7: "Manual input", 8: "Simulator mode",
}  # fmt: skip
#: Severity of an alarm -> state of its notification, and the ways to tell.
_STATES = {"warning": ("warn", ("visual",)), "alarm": ("alarm", ("visual", "sound"))}


@cache
def vessel_context() -> str:
    """The context of this boat for listeners that know no other: the same on every run on this machine.

    Made of the machine's own identity, which cannot be told from it.
    """
    try:
        secret = Path("/etc/machine-id").read_bytes().strip()
    except OSError:
        secret = uuid.uuid4().bytes
    digest = hmac.digest(secret, b"tinyekf signalk vessel", "sha256")
    return f"vessels.urn:mrn:signalk:uuid:{uuid.UUID(bytes=digest[:16], version=4)}"


def hello(now_utc: datetime) -> dict[str, Any]:
    """The first message to whoever connects."""
    return {
        "name": "tinyekf",
        "version": VERSION,
        "timestamp": _timestamp(now_utc),
        "self": vessel_context(),
        "roles": ["master", "main"],
    }


def delta(
    state: ViewState | None, waited_s: float, now_utc: datetime, alarms: Sequence[Alarm], *, context: str = SELF
) -> dict[str, Any]:
    """All values of `state`, `waited_s` seconds after it was made, at the moment `now_utc`, and the notification.

    `alarms` are those raised now, worst first; without any the notification says that all is normal. `context` is
    `SELF` for a Signal K server that takes them in, `vessel_context()` for listeners of our own.
    """
    state = state or ViewState(None)
    estimate = current_estimate(state, waited_s)
    navigation = current_navigation(state, waited_s)
    age_s = state.estimate_age_s + waited_s if estimate is state.estimate else 0.0
    values = {**_values(estimate, navigation, simulated=state.simulated), HEADING_NOTIFICATION: _notification(alarms)}
    update = {
        "$source": SIMULATED_SOURCE if state.simulated else SOURCE,
        "timestamp": _timestamp(now_utc - timedelta(seconds=age_s)),
        "values": [{"path": path, "value": value} for path, value in values.items()],
    }
    return {"context": context, "updates": [update]}


def json_line(message: Mapping[str, Any]) -> bytes:
    """A message as one line of strict JSON with its line end, as Signal K servers send it over TCP."""
    return json.dumps(message, separators=(",", ":"), allow_nan=False).encode() + b"\r\n"


def _values(estimate: Estimate, navigation: Navigation, *, simulated: bool) -> dict[str, Any]:
    heading_deg = estimate.heading_deg if estimate.mode != "invalid" else float("nan")
    rate_dps = estimate.rate_of_turn_dps if estimate.mode != "invalid" else float("nan")
    attitude = {
        "roll": _angle(navigation.roll_deg),
        "pitch": _angle(navigation.pitch_deg),
        "yaw": _angle(180.0 - (180.0 - heading_deg) % 360.0),  # (-180, 180], as NMEA 2000 has it
    }
    has_position = estimate.pos_mode != "invalid" and isfinite(estimate.lat_deg) and isfinite(estimate.lon_deg)
    position = {"latitude": round(estimate.lat_deg, 9), "longitude": round(estimate.lon_deg, 9)}
    return {
        "navigation.headingTrue": _angle(heading_deg % 360.0),
        "navigation.headingMagnetic": _angle((heading_deg - navigation.variation_deg) % 360.0),
        "navigation.magneticVariation": _angle(navigation.variation_deg),
        "navigation.rateOfTurn": _angle(rate_dps),
        "navigation.attitude": attitude if any(angle is not None for angle in attitude.values()) else None,
        "navigation.position": position if has_position else None,
        "navigation.speedOverGround": _number(navigation.sog_mps, 3),
        "navigation.courseOverGroundTrue": _angle(navigation.cog_deg % 360.0),
        "navigation.gnss.methodQuality": _method_quality(estimate, navigation, simulated=simulated),
        "navigation.gnss.satellites": navigation.satellites if navigation.satellites >= 0 else None,
        "navigation.gnss.horizontalDilution": _number(navigation.hdop, 2),
    }


def _method_quality(estimate: Estimate, navigation: Navigation, *, simulated: bool) -> str:
    """How the position came about: the one place where the format can say that it is simulated."""
    if estimate.pos_mode == "invalid":
        return "no GPS"
    if simulated:
        return "Simulator mode"
    if estimate.pos_mode == "dead-reckoning":
        return "Estimated (DR) mode"
    return _METHOD_QUALITY.get(navigation.fix_quality, "GNSS Fix")


def _notification(alarms: Sequence[Alarm]) -> dict[str, Any]:
    """One for all that is wrong with the heading, as the format has one notification for a value."""
    if not alarms:
        return {"state": "normal", "method": [], "message": "heading ok"}
    state, method = _STATES[alarms[0].severity]
    return {"state": state, "method": list(method), "message": "; ".join(alarm.text for alarm in alarms)}


def _angle(degrees: float) -> float | None:
    """Radians of degrees, to a millionth; None when not known."""
    return _number(radians(degrees), 6)


def _number(number: float, decimals: int) -> float | None:
    return round(number, decimals) + 0.0 if isfinite(number) else None  # + 0.0: never -0.0


def _timestamp(moment: datetime) -> str:
    return moment.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"

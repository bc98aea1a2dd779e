"""What a person watching the program is shown: the live program fills it, the console, the web page and all other
outputs are made of it.

Named tuples all the way down, so that the whole of it goes to the output process as one line of JSON
(`outputs.frame`).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import NamedTuple

from tinyekf_py.estimate import Estimate

NAN = float("nan")

#: An estimate older than this is no longer shown, seconds.
MAX_ESTIMATE_AGE_S = 1.0
#: A fix, HDOP or weight older than this is no longer shown, seconds.
MAX_SENSOR_AGE_S = 3.0

FIX_WORDS = {
    0: "none", 1: "GPS", 2: "DGPS", 3: "PPS", 4: "RTK", 5: "float RTK", 6: "estimated", 7: "manual", 8: "simulated",
}  # fmt: skip
KNOTS_PER_MPS = 3600.0 / 1852.0
WEIGHT_WORDS = {0: "bad", 1: "good", 2: "excellent", 3: "ideal"}


class SensorRow(NamedTuple):
    """One sensor as it is now."""

    name: str  #: as in `acquisition.sample.SOURCES`
    port_state: str  #: a word or two: open, missing, no permission, stale, stopped, ...
    rate_hz: float = NAN  #: samples a second
    age_s: float = NAN  #: since its last sample
    fix_quality: int = -1  #: GPS: as GGA's; -1 unknown
    hdop: float = NAN
    weight: float = NAN  #: GPS: of stage 1, 0 to 3
    errors: int = 0  #: lines dropped since the start
    last_error: str = ""  #: one line
    heading_deg: float = NAN  #: of this sensor alone, true, [0, 360): a GPS's course, the corrected compass
    heading_sigma_deg: float = NAN  #: its standard deviation as the fusion weighs it
    port_text: str = ""  #: why the port is in its state
    restarts: int = 0  #: of its worker
    lines: int = 0  #: received since the start
    samples: int = 0  #: made of them
    down_s: float = 0.0  #: time without data since the start
    dropped: tuple[tuple[str, int], ...] = ()  #: (reason, count) since the start


class TaskRow(NamedTuple):
    """One task as it is now."""

    key: str  #: that starts and stops it
    name: str
    running: bool


class Navigation(NamedTuple):
    """What a navigator is told beside the heading; NaN or -1 where it is not known now."""

    utc_s: float = NAN  #: of the newest fix, seconds since 1970-01-01 UTC
    sog_mps: float = NAN  #: speed over ground
    cog_deg: float = NAN  #: course over ground, true, [0, 360); never a heading
    altitude_m: float = NAN  #: above mean sea level
    fix_quality: int = -1  #: the best receiver's, as GGA's
    satellites: int = -1  #: used by that receiver
    hdop: float = NAN  #: of that receiver
    roll_deg: float = NAN  #: starboard down positive
    pitch_deg: float = NAN  #: bow up positive
    variation_deg: float = NAN  #: in use, east positive
    deviation_deg: float = NAN  #: of the compass at its present heading, as applied, east positive


class ViewState(NamedTuple):
    """Everything on the screen."""

    estimate: Estimate | None
    estimate_age_s: float = 0.0  #: since the estimate was made
    sensors: tuple[SensorRow, ...] = ()
    elapsed_s: float = 0.0  #: since the start
    method: str = ""
    recording: str = ""  #: path; empty when nothing is recorded
    simulated: bool = False  #: no real boat: simulated devices, or a replay
    notices: tuple[str, ...] = ()  #: one-line messages, the latest last
    tasks: tuple[TaskRow, ...] = ()
    navigation: Navigation = Navigation()
    recording_failure: str = ""  #: one line; empty while all is well
    recording_lost: int = 0  #: lines that could not be recorded
    position_of: str = ""  #: the point aboard whose position the estimate gives


def position_of(method: str, antennas_m: Sequence[object]) -> str:
    """The point aboard whose position `method` gives when the antennas' places, `antennas_m`, are configured."""
    known = method == "adaptive" and len(antennas_m) > 0
    return "the boat's reference point" if known else "the GPS antennas, their weighted mean"


def current_estimate(state: ViewState, waited_s: float) -> Estimate:
    """The estimate to show `waited_s` seconds after `state` was made: an invalid one when it is missing or stale."""
    if state.estimate is None or not state.estimate_age_s + waited_s <= MAX_ESTIMATE_AGE_S:
        return Estimate(0)
    return state.estimate


def current_navigation(state: ViewState, waited_s: float) -> Navigation:
    """What a navigator may be told `waited_s` seconds after `state` was made: nothing when that is long ago."""
    return state.navigation if waited_s <= MAX_ESTIMATE_AGE_S else Navigation()


def bearing_text(bearing_deg: float) -> str:
    """Degrees in [0, 360) with one decimal, "---" when not known; never 360.0."""
    if not isfinite(bearing_deg):
        return "---"
    text = f"{bearing_deg % 360.0:05.1f}"
    return "000.0" if text == "360.0" else text


def heading_text(estimate: Estimate) -> str:
    """Heading in degrees with one decimal, "---" when there is none; never 360.0."""
    return bearing_text(estimate.heading_deg) if estimate.mode != "invalid" else "---"


def position_text(estimate: Estimate, degree: str = "°") -> str:
    """Position in degrees and minutes, "---" when there is none."""
    if estimate.pos_mode == "invalid" or not (isfinite(estimate.lat_deg) and isfinite(estimate.lon_deg)):
        return "---"
    lat, lon = _minutes(estimate.lat_deg, 2, "NS", degree), _minutes(estimate.lon_deg, 3, "EW", degree)
    return f"{lat}  {lon}"


def _minutes(angle_deg: float, digits: int, sides: str, degree: str) -> str:
    degrees, thousandths = divmod(round(abs(angle_deg) * 60_000), 60_000)
    minutes, rest = divmod(thousandths, 1000)
    return f"{degrees:0{digits}d}{degree}{minutes:02d}.{rest:03d}' {sides[angle_deg < 0]}"


def turn_text(estimate: Estimate, unit: str = "°/s") -> str:
    """Rate of turn with its side in words, "---" when there is none."""
    rate_dps = estimate.rate_of_turn_dps
    if estimate.mode == "invalid" or not isfinite(rate_dps):
        return "---"
    tenths = f"{abs(rate_dps):.1f}"
    side = "" if tenths == "0.0" else " to starboard" if rate_dps > 0 else " to port"
    return f"{tenths} {unit}{side}"


def speed_text(speed_mps: float) -> str:
    """Speed in knots, "---" when not known."""
    return f"{speed_mps * KNOTS_PER_MPS:.1f} kn" if isfinite(speed_mps) else "---"


def sided_text(angle_deg: float, positive: str, negative: str, degree: str = "°") -> str:
    """An angle with its side in words, "---" when not known."""
    if not isfinite(angle_deg):
        return "---"
    tenths = f"{abs(angle_deg):.1f}"
    return f"{tenths}{degree}" + ("" if tenths == "0.0" else f" {positive if angle_deg > 0 else negative}")


def elapsed_text(elapsed_s: float) -> str:
    """h:mm:ss."""
    minutes, seconds = divmod(int(elapsed_s), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}"


class SensorWords(NamedTuple):
    """A sensor's row in words; "---" for what is unknown or too old to show, empty for what it cannot have."""

    name: str
    port_state: str
    rate: str
    age: str
    fix: str
    hdop: str
    weight: str
    errors: str
    own: str  #: a GPS's course as COG, the compass' heading as HDG: one is never taken for the other
    own_sigma: str  #: its standard deviation in degrees, empty when there is none


def sensor_words(row: SensorRow, waited_s: float) -> SensorWords:
    """`row` in words, `waited_s` seconds after it was made."""
    age_s = row.age_s + waited_s
    fresh = row.port_state == "open" and age_s <= MAX_SENSOR_AGE_S
    fix = hdop = weight = own = own_sigma = ""
    if row.name != "imu":
        own = f"{'HDG' if row.name == 'compass' else 'COG'} {bearing_text(row.heading_deg if fresh else NAN)}"
        own_sigma = f"{row.heading_sigma_deg:.1f}" if fresh and isfinite(row.heading_sigma_deg) else ""
    if row.name.startswith("gps"):
        fix = hdop = weight = "---"
        if fresh:
            fix = FIX_WORDS.get(row.fix_quality, "---")
            hdop = f"{row.hdop:.1f}" if isfinite(row.hdop) else "---"
            if isfinite(row.weight):
                weight = f"{round(row.weight, 1):g} {WEIGHT_WORDS.get(round(row.weight), '')}".rstrip()
    return SensorWords(
        name=row.name,
        port_state=row.port_state,
        rate=f"{row.rate_hz:.1f} Hz" if fresh and isfinite(row.rate_hz) else "---",
        age="---" if not isfinite(age_s) else f"{age_s:.1f} s" if age_s < 1000 else "> 999 s",
        fix=fix,
        hdop=hdop,
        weight=weight,
        errors=str(row.errors) if row.errors < 100_000 else f"{row.errors // 1000}k",
        own=own,
        own_sigma=own_sigma,
    )

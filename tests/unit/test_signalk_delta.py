"""Signal K deltas: SI units and radians, null for what is not known, notifications, strict JSON."""

from __future__ import annotations

import json
import math
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tinyekf_py.alarms import HEADING_INVALID, SOURCES_DISAGREE, Alarm, Alarms
from tinyekf_py.estimate import MODES, POSITION_MODES, Estimate
from tinyekf_py.outputs.signalk_delta import SELF, delta, hello, json_line, vessel_context
from tinyekf_py.view_state import Navigation, ViewState

NAN = float("nan")
NOW = datetime(2026, 11, 24, 3, 0, 5, 250_000, UTC)
ESTIMATE = Estimate(12_300_000, 90.0, 0.52, -1.5, 35.960026123, -126.519994, "ok", "gps", (3.0, 2.0, 0.0))
NAVIGATION = Navigation(
    sog_mps=4.25, cog_deg=100.0, fix_quality=2, satellites=9, hdop=1.04, roll_deg=-3.0, pitch_deg=1.5,
    variation_deg=-8.5,
)  # fmt: skip
STATE = ViewState(ESTIMATE, 0.05, navigation=NAVIGATION)
HEADING_NOTIFICATION = "notifications.navigation.headingTrue"


def values_of(state: ViewState | None, waited_s: float = 0.0) -> dict[str, Any]:
    (update,) = delta(state, waited_s, NOW, ())["updates"]
    return {entry["path"]: entry["value"] for entry in update["values"]}


def test_values_are_in_si_and_radians() -> None:
    values = values_of(STATE)
    assert values["navigation.headingTrue"] == pytest.approx(math.radians(90.0), abs=1e-6)
    assert values["navigation.headingMagnetic"] == pytest.approx(math.radians(98.5), abs=1e-6)
    assert values["navigation.magneticVariation"] == pytest.approx(math.radians(-8.5), abs=1e-6)
    assert values["navigation.rateOfTurn"] == pytest.approx(math.radians(-1.5), abs=1e-6)
    assert values["navigation.attitude"] == {
        "roll": pytest.approx(math.radians(-3.0), abs=1e-6),
        "pitch": pytest.approx(math.radians(1.5), abs=1e-6),
        "yaw": pytest.approx(math.radians(90.0), abs=1e-6),
    }
    assert values["navigation.position"] == {"latitude": 35.960026123, "longitude": -126.519994}
    assert values["navigation.speedOverGround"] == 4.25
    assert values["navigation.courseOverGroundTrue"] == pytest.approx(math.radians(100.0), abs=1e-6)
    assert values["navigation.gnss.methodQuality"] == "DGNSS fix"
    assert values["navigation.gnss.satellites"] == 9
    assert values["navigation.gnss.horizontalDilution"] == 1.04


def test_it_says_when_and_by_whom() -> None:
    message = delta(STATE, 0.2, NOW, ())
    assert message["context"] == SELF == "vessels.self"
    (update,) = message["updates"]
    assert update["$source"] == "tinyekf"
    assert update["timestamp"] == "2026-11-24T03:00:05.000Z"  # 0.05 s old when it came, 0.2 s ago
    elsewhere = NOW.astimezone(datetime.strptime("+09:00", "%z").tzinfo)
    assert delta(STATE, 0.2, elsewhere, ()) == message


def test_what_is_not_known_is_null() -> None:
    values = values_of(ViewState(Estimate(0)))
    for path, value in values.items():
        assert value is None or path in (HEADING_NOTIFICATION, "navigation.gnss.methodQuality"), path
    assert values["navigation.gnss.methodQuality"] == "no GPS"
    partly = values_of(STATE._replace(navigation=NAVIGATION._replace(roll_deg=NAN, variation_deg=NAN)))
    assert partly["navigation.attitude"]["roll"] is None
    assert partly["navigation.attitude"]["pitch"] is not None
    assert partly["navigation.headingMagnetic"] is None
    assert partly["navigation.headingTrue"] is not None


@pytest.mark.parametrize(
    ("state", "waited_s"),
    [(None, 0.0), (None, math.inf), (STATE, 1.0), (STATE, math.inf), (STATE._replace(estimate_age_s=1.1), 0.0)],
)
def test_an_old_heading_is_never_given(state: ViewState | None, waited_s: float) -> None:
    values = values_of(state, waited_s)
    for name in ("headingTrue", "headingMagnetic", "rateOfTurn", "position"):
        assert values[f"navigation.{name}"] is None


def test_an_old_course_is_never_given() -> None:
    values = values_of(STATE, 1.5)
    assert values["navigation.courseOverGroundTrue"] is None
    assert values["navigation.speedOverGround"] is None
    assert values["navigation.attitude"] is None


def test_an_invalid_heading_is_null_even_where_a_number_stands() -> None:
    values = values_of(STATE._replace(estimate=ESTIMATE._replace(mode="invalid")))
    assert values["navigation.headingTrue"] is None
    assert values["navigation.rateOfTurn"] is None
    assert values["navigation.position"] is not None


def notification_of(*alarms: Alarm) -> dict[str, Any]:
    (update,) = delta(STATE, 0.0, NOW, alarms)["updates"]
    (value,) = [entry["value"] for entry in update["values"] if entry["path"] == HEADING_NOTIFICATION]
    return dict(value)


def test_alarms_are_notified_as_one_of_the_worst_state_and_cleared() -> None:
    lost = Alarm(HEADING_INVALID, "alarm", "no heading: gps1 missing", 12.0)
    odd = Alarm(SOURCES_DISAGREE, "warning", "the headings of gps2 and compass disagree", 3.0)
    both = notification_of(lost, odd)
    assert both["state"] == "alarm"
    assert both["method"] == ["visual", "sound"]
    assert both["message"] == "no heading: gps1 missing; the headings of gps2 and compass disagree"
    assert notification_of(odd)["state"] == "warn"
    assert notification_of(odd)["method"] == ["visual"]
    assert notification_of() == {"state": "normal", "method": [], "message": "heading ok"}


def test_simulated_data_are_marked_where_the_format_can() -> None:
    message = delta(STATE._replace(simulated=True), 0.0, NOW, ())
    assert message["updates"][0]["$source"] == "tinyekf.simulated"
    assert values_of(STATE._replace(simulated=True))["navigation.gnss.methodQuality"] == "Simulator mode"


@pytest.mark.parametrize(
    ("pos_mode", "fix_quality", "word"),
    [
        ("gps", 1, "GNSS Fix"), ("gps", 4, "RTK fixed integer"), ("gps", -1, "GNSS Fix"),
        ("dead-reckoning", 1, "Estimated (DR) mode"), ("invalid", 1, "no GPS"),
    ],
)  # fmt: skip
def test_a_position_says_how_it_came_about(pos_mode: str, fix_quality: int, word: str) -> None:
    state = STATE._replace(
        estimate=ESTIMATE._replace(pos_mode=pos_mode), navigation=NAVIGATION._replace(fix_quality=fix_quality)
    )
    assert values_of(state)["navigation.gnss.methodQuality"] == word


@pytest.mark.parametrize(("heading_deg", "yaw_deg"), [(0.0, 0.0), (180.0, 180.0), (180.001, -179.999), (359.0, -1.0)])
def test_yaw_is_signed(heading_deg: float, yaw_deg: float) -> None:
    values = values_of(STATE._replace(estimate=ESTIMATE._replace(heading_deg=heading_deg)))
    assert values["navigation.attitude"]["yaw"] == pytest.approx(math.radians(yaw_deg), abs=1e-6)


anything = st.floats(allow_nan=True, allow_infinity=True)


@given(
    st.builds(
        ViewState,
        st.builds(
            Estimate,
            st.just(0),
            *(st.just(NAN) | st.floats(0.0, 360.0), anything, anything, anything, anything),
            st.sampled_from(MODES),
            st.sampled_from(POSITION_MODES),
        ),
        st.floats(0.0, 2.0),
        navigation=st.builds(Navigation, *[anything] * 4, st.integers(-1, 9), st.integers(-1, 99), *[anything] * 5),
    ),
    st.floats(0.0, 2.0) | st.just(math.inf),
)
def test_every_state_is_strict_json_and_short(state: ViewState, waited_s: float) -> None:
    line = json_line(delta(state, waited_s, NOW, Alarms().update(state, waited_s)))
    assert line.endswith(b"\r\n")
    assert line.count(b"\n") == 1

    def refused(constant: str) -> None:
        raise AssertionError(constant)

    values = {
        entry["path"]: entry["value"] for entry in json.loads(line, parse_constant=refused)["updates"][0]["values"]
    }
    heading = values["navigation.headingTrue"]
    assert heading is None or 0.0 <= heading < 2 * math.pi
    assert len(line) < 2048  # signalk-server drops what is longer


def test_hello_names_the_vessel_by_a_lasting_identity() -> None:
    greeting = hello(NOW)
    assert greeting["version"] == "1.7.0"
    assert greeting["roles"] == ["master", "main"]
    assert greeting["self"] == vessel_context() == hello(NOW + timedelta(days=1))["self"]
    assert greeting["self"].startswith("vessels.urn:mrn:signalk:uuid:")
    assert greeting["self"][len("vessels.urn:mrn:signalk:uuid:") :][14] == "4"


def test_listeners_of_our_own_get_the_vessels_name() -> None:
    assert delta(STATE, 0.0, NOW, (), context=vessel_context())["context"] == hello(NOW)["self"]

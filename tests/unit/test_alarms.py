"""Alarms: they come when their cause lasts, say which sensor it is, and do not flicker."""

from __future__ import annotations

import pytest

from tinyekf_py.alarms import HEADING_DEGRADED, HEADING_INVALID, SOURCES_DISAGREE, Alarm, Alarms
from tinyekf_py.estimate import Estimate
from tinyekf_py.view_state import SensorRow, TaskRow, ViewState

OK = Estimate(0, 12.0, 0.5, 0.0, 54.0, 10.0, "ok", "gps")


def row(name: str, heading_deg: float = 12.0, sigma_deg: float = 3.0, **more: object) -> SensorRow:
    return SensorRow(name, "open", 10.0, 0.05)._replace(heading_deg=heading_deg, heading_sigma_deg=sigma_deg, **more)


ROWS = (row("gps1"), row("gps2"), row("gps3"), row("compass"), SensorRow("imu", "open"))


def sail(alarms: Alarms, state: ViewState, seconds: float, waited_s: float = 0.0) -> tuple[Alarm, ...]:
    """The alarms after `seconds` more of `state`, ten a second; the state's clock goes on."""
    raised: tuple[Alarm, ...] = ()
    for step in range(round(seconds * 10) + 1):
        raised = alarms.update(state._replace(elapsed_s=state.elapsed_s + step / 10), waited_s)
    return raised


def ids(alarms: tuple[Alarm, ...]) -> list[str]:
    return [alarm.id for alarm in alarms]


def test_all_well_is_no_alarm() -> None:
    assert sail(Alarms(), ViewState(OK, sensors=ROWS), 60.0) == ()


@pytest.mark.parametrize(
    "state", [None, ViewState(None), ViewState(OK._replace(mode="invalid")), ViewState(OK, estimate_age_s=1.1)]
)
def test_a_heading_that_is_gone_is_told_at_once(state: ViewState | None) -> None:
    (alarm,) = Alarms().update(state, 0.0)
    assert (alarm.id, alarm.severity) == (HEADING_INVALID, "alarm")
    assert alarm.text.startswith("no heading")


@pytest.mark.parametrize("before", [ViewState(None), ViewState(OK._replace(mode="invalid"))])
def test_the_first_heading_ends_the_waiting_for_it_at_once(before: ViewState) -> None:
    alarms = Alarms()
    assert ids(sail(alarms, before, 2.0)) == [HEADING_INVALID]
    assert alarms.update(ViewState(OK, sensors=ROWS, elapsed_s=2.1), 0.0) == ()
    (lost,) = alarms.update(ViewState(OK._replace(mode="invalid"), sensors=ROWS, elapsed_s=10.0), 0.0)
    assert alarms.update(ViewState(OK, sensors=ROWS, elapsed_s=10.1), 0.0) == (lost,)  # that may be a flicker


def test_no_news_for_a_second_is_no_heading() -> None:
    alarms = Alarms()
    assert alarms.update(ViewState(OK, sensors=ROWS, elapsed_s=10.0), 0.9) == ()
    assert ids(alarms.update(ViewState(OK, sensors=ROWS, elapsed_s=10.0), 1.1)) == [HEADING_INVALID]


def test_a_degraded_heading_says_why() -> None:
    rows = (SensorRow("gps1", "missing"), row("gps2", fix_quality=0), *ROWS[2:4], SensorRow("imu", "stopped"))
    tasks = (TaskRow("i", "imu", False), TaskRow("s", "cnw-s1", False))
    state = ViewState(OK._replace(mode="degraded"), sensors=rows, tasks=tasks)
    (alarm,) = sail(Alarms(), state, 2.0)
    assert alarm[:3] == (
        HEADING_DEGRADED,
        "warning",
        "heading degraded: gps1 missing, imu stopped, gps2 without a fix, cnw-s1 stopped",
    )


def test_dead_reckoning_is_worse_than_degraded() -> None:
    (alarm,) = sail(Alarms(), ViewState(OK._replace(mode="dead-reckoning"), sensors=ROWS), 2.0)
    assert (alarm.id, alarm.severity, alarm.text) == (HEADING_DEGRADED, "alarm", "heading by the gyro alone")


def test_a_moment_is_no_alarm_and_a_raised_one_stays_a_while() -> None:
    alarms = Alarms()
    good, bad = ViewState(OK, sensors=ROWS), ViewState(OK._replace(mode="degraded"), sensors=ROWS)
    for second in range(0, 10, 2):
        assert sail(alarms, bad._replace(elapsed_s=second), 0.5) == ()
        assert sail(alarms, good._replace(elapsed_s=second + 0.6), 0.5) == ()
    (raised,) = sail(alarms, bad._replace(elapsed_s=20.0), 1.5)
    assert raised.since_s == pytest.approx(21.0)
    assert sail(alarms, good._replace(elapsed_s=22.0), 2.0) == (raised,)
    assert sail(alarms, good._replace(elapsed_s=24.1), 2.0) == ()


@pytest.mark.parametrize(("compass_deg", "gps_deg"), [(40.0, 5.0), (350.0, 15.0), (15.0, 350.0)])
def test_a_contradiction_names_the_one_against_the_others(compass_deg: float, gps_deg: float) -> None:
    rows = (*(row(f"gps{i}", gps_deg, 5.0) for i in (1, 2, 3)), row("compass", compass_deg, 2.0))
    alarms = Alarms()
    assert sail(alarms, ViewState(OK, sensors=rows), 4.0) == ()
    (alarm,) = sail(alarms, ViewState(OK, sensors=rows, elapsed_s=4.1), 2.0)
    assert alarm.id == SOURCES_DISAGREE
    assert alarm.text == "the headings of compass and gps1, gps2, gps3 disagree"


def test_headings_within_their_sigmas_across_north_agree() -> None:
    rows = (row("gps1", 358.0, 3.0), row("compass", 5.0, 3.0))
    assert sail(Alarms(), ViewState(OK, sensors=rows), 30.0) == ()


def test_a_silent_source_contradicts_nobody() -> None:
    rows = (row("gps1", 90.0), row("compass", 0.0, age_s=4.0))
    assert sail(Alarms(), ViewState(OK, sensors=rows), 30.0) == ()

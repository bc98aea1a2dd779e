"""Cables that are pulled, workers that die or hang: one program lives through all of it."""

from __future__ import annotations

import os
import signal
from typing import Any

import pytest
from live_boat import SENSORS

WITHIN_S = 1.0  # in which an unplugged sensor must be seen in the mode
GRID_S = 0.1  # of the rows
SLACK_S = 1.0  # of a loaded machine that runs these tests


def gone(*names: str) -> Any:
    """Whether these sensors are not open, and the heading is not called ok."""
    return lambda s: s["mode"] != "ok" and all(s["sensors"][name]["port_state"] != "open" for name in names)


@pytest.mark.parametrize("name", SENSORS)
def test_a_sensor_is_unplugged_and_replugged(life: Any, name: str) -> None:
    cable = life.boat.cables[name]
    row = life.row(f"{name} unplugged, replugged", cable.unplug, gone(name), cable.plug, broken=(name,))
    assert row.noticed_s <= WITHIN_S + GRID_S + SLACK_S
    assert row.whole_s <= 2.0 + SLACK_S


def test_all_sensors_are_unplugged_and_replugged_at_once(life: Any) -> None:
    def unplug() -> None:
        for cable in life.boat.cables.values():
            cable.unplug()

    def plug() -> None:
        for cable in life.boat.cables.values():
            cable.plug()

    row = life.row("all five unplugged, replugged", unplug, lambda s: s["mode"] == "invalid", plug, broken=SENSORS)
    assert row.whole_s <= 2.0 + SLACK_S


def test_a_sensor_comes_back_under_another_name(life: Any) -> None:
    cable = life.boat.cables["gps2"]
    before = os.readlink(cable.link)
    row = life.row(
        "gps2 replugged under another name", cable.unplug, gone("gps2"), cable.plug_elsewhere, broken=("gps2",)
    )
    assert os.readlink(cable.link) != before
    assert row.whole_s <= 2.0 + SLACK_S


@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_worker_is_killed_or_stopped(life: Any, name: str, number: signal.Signals) -> None:
    sensor = life.live.until_whole()["sensors"][name]
    restarts = sensor["restarts"]
    life.row(
        f"worker of {name}: {number.name}",
        lambda: os.kill(sensor["pid"], number),
        lambda s: s["sensors"][name]["restarts"] > restarts,
        broken=(name,),
    )

"""The library of voyages: what is sailed, where, and what goes wrong. Values only; to add one, add a row."""

from __future__ import annotations

import difflib
from dataclasses import dataclass, replace

from acquisition.simulator.faults import ALL_GPS, Disturbance, Fault, Jumps, NoFix, Silence
from acquisition.simulator.helm import Leg, circle, zigzag
from acquisition.simulator.vessel import Sea, Waters

DEVICES = (*ALL_GPS, "compass", "imu")

#: Rate of turn of the circle with which a settled run begins, and its least speed through the water.
_SETTLING_TURN_DPS = 4.0
_SETTLING_SPEED_MPS = 2.5

_SLIGHT = Sea(roll_deg=2.0, pitch_deg=1.0, yaw_deg=0.5, surge_mps=0.06, sway_mps=0.06, heave_mps=0.1)
_SHELTERED = Sea(period_s=3.5, roll_deg=0.6, pitch_deg=0.3, yaw_deg=0.2, surge_mps=0.02, sway_mps=0.02, heave_mps=0.02)
_MOORED = Sea(period_s=12.0, roll_deg=0.8, pitch_deg=0.3, yaw_deg=0.5, surge_mps=0.02, sway_mps=0.02, heave_mps=0.02)

_OPEN_WATER = Waters(sea=_SLIGHT)
_HARBOUR = Waters(sea=_SHELTERED)


class ScenarioError(ValueError):
    """A scenario that does not exist."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """A voyage. The plan is sailed over and over; times of faults are seconds of the run."""

    name: str
    summary: str  #: one line
    plan: tuple[Leg, ...]
    heading_deg: float  #: true, at the start
    speed_mps: float  #: through the water, at the start
    waters: Waters = _OPEN_WATER
    faults: tuple[Fault, ...] = ()
    devices: tuple[str, ...] = DEVICES
    prefix: tuple[Leg, ...] = ()  #: sailed once, before the plan
    duration_s: float = 600.0


_STRAIGHT = (Leg(600.0, 18.01),)
_TURNS = (
    Leg(100.0, 60.0),
    Leg(80.0, 150.0),
    Leg(90.0, 280.0),
    circle(-4.0),
    Leg(80.0, 350.0),
    Leg(90.0, 30.0),
)

_ALL = (
    Scenario(
        "tour",
        "a round trip with legs, turns and a circle, crossing north; 5 to 2 m/s",
        (
            Leg(35.0, 330.0, speed_mps=5.0),
            Leg(30.0, 30.0),
            Leg(30.0, 340.0),
            Leg(25.0, 20.0),
            Leg(40.0, 95.0, max_turn_dps=10.0),
            Leg(35.0, 175.0, speed_mps=3.0),
            circle(6.0, speed_mps=3.0),
            Leg(30.0, 210.0, speed_mps=2.0),
            Leg(45.0, 265.0, speed_mps=5.0, max_turn_dps=8.0),
        ),
        330.0,
        5.0,
    ),
    Scenario("straight", "straight ahead at 18.01 degrees and 5 m/s", _STRAIGHT, 18.01, 5.0),
    Scenario(
        "straight-blackout",
        "as straight; all GPS without a fix, or silent, for 30, 60 and 90 s",
        _STRAIGHT,
        18.01,
        5.0,
        faults=(NoFix(120.0, 150.0), Silence(240.0, 300.0, ALL_GPS), NoFix(420.0, 510.0)),
    ),
    Scenario("north", "zig-zag of 25 degrees across north at 4 m/s", zigzag(0.0, 25.0, 30.0), 335.0, 4.0),
    Scenario("north-straight", "straight north at 5 m/s, within 2 degrees of 0", zigzag(0.0, 1.8, 20.0), 0.0, 5.0),
    Scenario(
        "harbour",
        "slow turns in the harbour, 0.4 to 4 m/s",
        (
            Leg(40.0, 40.0, speed_mps=4.0),
            Leg(35.0, 120.0, speed_mps=2.0),
            Leg(40.0, 200.0, speed_mps=0.8, max_turn_dps=4.0),
            Leg(45.0, 185.0, speed_mps=0.4),
            Leg(30.0, turn_dps=-5.0, speed_mps=1.0),
            Leg(40.0, 330.0, speed_mps=1.5),
            Leg(35.0, 20.0, speed_mps=2.5, max_turn_dps=8.0),
            circle(7.0, speed_mps=2.0),
            Leg(35.0, 290.0, speed_mps=3.0),
            Leg(40.0, 240.0, speed_mps=0.6),
        ),
        40.0,
        4.0,
        waters=_HARBOUR,
    ),
    Scenario(
        "dock", "moored: 0 m/s", (Leg(600.0, 72.0, speed_mps=0.0),), 72.0, 0.0, waters=replace(_HARBOUR, sea=_MOORED)
    ),
    Scenario(
        "current",
        "0.45 m/s of current across the first leg of a 3 m/s boat, with turns",
        (
            Leg(120.0, 0.0),
            Leg(90.0, 90.0),
            Leg(90.0, 200.0),
            circle(4.0),
            Leg(90.0, 310.0),
            Leg(90.0, 45.0),
        ),
        0.0,
        3.0,
        waters=replace(_OPEN_WATER, set_deg=90.0, drift_mps=0.45),
    ),
    Scenario(
        "faulty-gps",
        "straight and turns while GPS 2 jumps by 25 m with good HDOP",
        (Leg(200.0, 18.01), *_TURNS),
        18.01,
        5.0,
        faults=(Jumps(60.0, 540.0, ("gps2",)),),
    ),
    Scenario(
        "magnetic",
        "as straight; the compass disturbed by 35 degrees for 110 s",
        _STRAIGHT,
        18.01,
        5.0,
        faults=(Disturbance(200.0, 310.0),),
    ),
    Scenario(
        "lost-compass", "turns at 4 m/s; the compass falls silent after 120 s", _TURNS, 60.0, 4.0,
        faults=(Silence(120.0, sources=("compass",)),),
    ),
    Scenario(
        "lost-imu", "turns at 4 m/s; the IMU falls silent after 120 s", _TURNS, 60.0, 4.0,
        faults=(Silence(120.0, sources=("imu",)),),
    ),
)  # fmt: skip

SCENARIOS: dict[str, Scenario] = {scenario.name: scenario for scenario in _ALL}


def scenario_named(name: str) -> Scenario:
    """The scenario of that name; ScenarioError names the nearest when there is none."""
    if name in SCENARIOS:
        return SCENARIOS[name]
    near = difflib.get_close_matches(name, SCENARIOS, n=1, cutoff=0.0)
    raise ScenarioError(f"no scenario {name!r}; the nearest is {near[0]!r}, --list shows all")


def settled(scenario: Scenario) -> Scenario:
    """The same voyage after a full circle at constant water speed, in which a filter can learn the current.

    Faults come later by the time that the circle takes.
    """
    start = circle(_SETTLING_TURN_DPS, speed_mps=max(scenario.speed_mps, _SETTLING_SPEED_MPS))
    home = Leg(15.0, scenario.heading_deg, speed_mps=scenario.speed_mps)
    delay_s = start.duration_s + home.duration_s
    faults = tuple(
        replace(fault, start_s=fault.start_s + delay_s, end_s=fault.end_s + delay_s) for fault in scenario.faults
    )
    speed_mps = start.speed_mps or scenario.speed_mps
    return replace(scenario, prefix=(start, home), faults=faults, speed_mps=speed_mps)

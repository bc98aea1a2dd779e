"""A voyage: the boat sails, her devices sense, and their lines come in the order in which they arrive."""

from __future__ import annotations

import heapq
from datetime import UTC, datetime
from typing import NamedTuple, Protocol

from acquisition.simulator.compass import Compass
from acquisition.simulator.faults import ALL_GPS, Silence
from acquisition.simulator.gps import GpsReceiver, SharedError
from acquisition.simulator.grades import Grade
from acquisition.simulator.imu import Imu
from acquisition.simulator.scenarios import Scenario
from acquisition.simulator.vessel import STEP_US, Motion, Vessel

#: UTC of a voyage's start where nothing else is asked for.
START_UTC = datetime(2026, 11, 24, 3, tzinfo=UTC)
#: Places of the GPS antennas: forward, to starboard, up from the boat's reference point, m.
ANTENNAS_M = {"gps1": (1.5, -0.8, 2.5), "gps2": (1.5, 0.8, 2.5), "gps3": (-1.2, 0.0, 2.8)}

_PERIOD_STEPS = 10  # of GPS and compass
_COMPASS_PHASE = 3  # the compass does not know the GPS clock


def antennas_m() -> list[list[float]]:
    """Places of gps1, gps2, ... as a configuration has them: ahead and to starboard of the reference point, m."""
    return [[ahead, to_starboard] for ahead, to_starboard, _ in ANTENNAS_M.values()]


class Arrival(NamedTuple):
    """A line, complete at the reader's end of the cable."""

    t_us: int  #: microseconds since the voyage's start
    source: str
    line: bytes  #: without its ending


class Mover(Protocol):
    """What carries the devices: the simulated vessel, or a trajectory that once was sailed."""

    @property
    def motion(self) -> Motion: ...

    def advance(self) -> None: ...


class Voyage:
    """One run of a scenario. `advance` takes it 10 ms further; the same arguments give the same lines.

    `mover` carries the devices in place of the scenario's own vessel. Epochs of the GPS lie on whole tenths of UTC
    when `start_utc` does.
    """

    def __init__(
        self,
        scenario: Scenario,
        grade: Grade,
        *,
        seed: int = 1,
        start_utc: datetime = START_UTC,
        mover: Mover | None = None,
    ) -> None:
        self.scenario = scenario
        self.start_utc = start_utc
        waters = scenario.waters
        self._mover: Mover = mover or Vessel(
            scenario.plan,
            waters,
            heading_deg=scenario.heading_deg,
            speed_mps=scenario.speed_mps,
            seed=seed,
            prefix=scenario.prefix,
        )
        faults = scenario.faults
        self._shared = SharedError(grade.gps, seed)
        self.receivers = {
            name: GpsReceiver(name, grade.gps, ANTENNAS_M[name], faults, start_utc, seed)
            for name in ALL_GPS
            if name in scenario.devices
        }
        self.compass = Compass(grade.compass, waters.variation_deg, faults, seed)
        self.imu = Imu(grade.imu, waters.variation_deg, seed)
        self._silences = [fault for fault in faults if isinstance(fault, Silence)]
        self._on_the_wire: list[tuple[int, int, str, bytes]] = []
        self._count = 0
        self._latest_us = dict.fromkeys(scenario.devices, 0)
        self._sense()

    @property
    def motion(self) -> Motion:
        """The truth at this moment."""
        return self._mover.motion

    def advance(self) -> list[Arrival]:
        """Go on by 10 ms: the lines that arrived meanwhile, in order."""
        self._mover.advance()
        self._sense()
        now_us = self.motion.step * STEP_US
        waiting = self._on_the_wire
        arrived = []
        while waiting and waiting[0][0] <= now_us:
            t_us, _, source, line = heapq.heappop(waiting)
            arrived.append(Arrival(t_us, source, line))
        return arrived

    def _sense(self) -> None:
        motion = self._mover.motion
        if "imu" in self._latest_us:
            self._send("imu", self.imu.reading(motion))
        phase = motion.step % _PERIOD_STEPS
        if phase == 0:
            shared_m = self._shared.step()
            for name, receiver in self.receivers.items():
                self._send(name, receiver.epoch(motion, shared_m))
        elif phase == _COMPASS_PHASE and "compass" in self._latest_us:
            self._send("compass", self.compass.reading(motion))

    def _send(self, source: str, printed: list[tuple[int, bytes]]) -> None:
        if self._silences:
            t_s = self.motion.t_s
            if any(source in fault.sources and fault.active(t_s) for fault in self._silences):
                return
        now_us = self.motion.step * STEP_US
        for delay_us, line in printed:
            t_us = max(now_us + delay_us, self._latest_us[source] + 1)  # a wire keeps the order of its lines
            self._latest_us[source] = t_us
            self._count += 1
            heapq.heappush(self._on_the_wire, (t_us, self._count, source, line))

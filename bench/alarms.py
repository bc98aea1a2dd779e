"""Which alarms a voyage raises, and when: of the simulator's scenarios, or of recordings.

python bench/alarms.py [SCENARIO | RECORDING ...]
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from acquisition.recording import read_recording
from tinyekf_py.alarms import Alarms
from tinyekf_py.replay import Replay
from tinyekf_py.watched_replay import WatchedReplay

SCENARIOS = ("tour", "harbour", "current", "faulty-gps", "dock", "magnetic")
FASTER = 1e6  # than real time: as fast as it goes


def listen(recording: Path) -> None:
    """Print each alarm of a recording as it comes and goes."""
    watched = WatchedReplay(Replay(read_recording(recording)))
    alarms = Alarms()
    before: set[str] = set()
    for _ in watched.rows(FASTER, lambda _seconds: False):
        state = watched.view_state()
        raised = {alarm.id: alarm for alarm in alarms.update(state._replace(estimate_age_s=0.0), 0.0)}
        for name in sorted(raised.keys() - before):
            print(f"  {state.elapsed_s:7.1f} s  {raised[name].severity}: {raised[name].text}")
        for name in sorted(before - raised.keys()):
            print(f"  {state.elapsed_s:7.1f} s  gone: {name}")
        before = set(raised)


def main() -> None:
    """The command."""
    for what in sys.argv[1:] or SCENARIOS:
        print(what)
        if Path(what).is_file():
            listen(Path(what))
            continue
        with tempfile.TemporaryDirectory() as folder:
            recording = Path(folder) / "rec.log"
            simulate = [sys.executable, "-m", "acquisition.simulator", str(recording), f"{folder}/truth.csv"]
            subprocess.run([*simulate, "--scenario", what], check=True)
            listen(recording)


if __name__ == "__main__":
    main()

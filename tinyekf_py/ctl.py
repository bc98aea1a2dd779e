"""`tinyekf ctl`: see and switch the tasks of a running program from a second terminal.

Exit status: 0 done, 1 no program answers, 2 the command line is wrong or there is no such task.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tinyekf_py.command_line import OneLineParser, complain
from tinyekf_py.control_socket import ControlError, call, calling_path


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(prog="tinyekf ctl", description="See and switch the tasks of a running program.")
    parser.add_argument("verb", choices=("status", "start", "stop"))
    parser.add_argument("task", nargs="?", default="", help="with start and stop: a task of the status, or all")
    parser.add_argument("--socket", type=Path, metavar="PATH", help="the program's socket (default: found by itself)")
    parser.add_argument("--json", action="store_true", help="print the answer as it came")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Send the command and print the answer; the exit status."""
    parser = _parser()
    options = parser.parse_args(argv)
    if (options.verb == "status") != (not options.task):
        parser.error("status takes no task" if options.task else f"{options.verb} which task? (or: all)")
    words = [options.verb, *filter(None, [options.task])]
    try:
        answer = call(options.socket or calling_path(), *words)
    except ControlError as error:
        return complain("ctl", error, 1)
    if "error" in answer:
        return complain("ctl", RuntimeError(answer["error"]))
    print(json.dumps(answer) if options.json else status_text(answer), flush=True)
    return 0


def status_text(status: dict[str, Any]) -> str:
    """The status for people: heading, tasks, sensors with their counters, recording."""
    heading = "---" if status["heading_deg"] is None else f"{status['heading_deg']:.1f}"
    lines = [f"{status['t_s']:.1f} s  {status['method']}  heading {heading}  {status['mode']}/{status['pos_mode']}", ""]
    lines += [f"{name:8} {'running' if running else 'stopped'}" for name, running in status["tasks"].items()]
    row = "{:8} {:8} {:>8} {:>9} {:>9} {:>8} {:>9}  {}"
    lines += ["", row.format("sensor", "port", "rate Hz", "lines", "samples", "restarts", "stale s", "dropped")]
    for name, sensor in status["sensors"].items():
        dropped = ", ".join(f"{reason} {n}" for reason, n in sensor["dropped"].items()) or "none"
        rate = "---" if sensor["rate_hz"] is None else f"{sensor['rate_hz']:.1f}"
        numbers = (rate, sensor["lines"], sensor["samples"], sensor["restarts"])
        lines.append(row.format(name, sensor["port_state"], *numbers, f"{sensor['stale_s']:.1f}", dropped))
    recording = status["recording"]
    if recording["path"]:
        state = recording["failure"] or "written"
        lines += ["", f"recording {recording['path']}: {state}, {recording['lost']} entries lost"]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())

"""The console script `tinyekf`: its first word names the command, the rest is the command's own."""

from __future__ import annotations

import importlib
import sys

from tinyekf_py.quiet_end import ended_quietly

#: Command -> module with a `main(argv)`, imported when asked for, and what it does.
COMMANDS = {
    "run": ("tinyekf_py.run", "the heading, live, simulated or replayed"),
    "ctl": ("tinyekf_py.ctl", "see, start and stop the tasks of a running program"),
    "calibrate": ("tinyekf_py.calibrate.command", "the compass' deviation and the gyro's bias, from a recording"),
    "tune": ("tinyekf_py.tune", "Q and R of the papers' filters, from recordings"),
    "evaluate": ("tinyekf_py.evaluate.command", "methods against the truth: a table and pictures"),
    "export": ("tinyekf_py.export.command", "a recording as CSV, Parquet or MCAP for other tools"),
    "devices": ("tinyekf_py.devices", "find the sensors, give them lasting names, check these"),
    "simulate": ("acquisition.simulator.command", "a boat with five devices, as a recording with truth or on ptys"),
    "vehicle": ("tinyekf_py.vehicle.command", "position and azimuth of a land vehicle"),
}


def main() -> int:
    """Run the command that the command line names; its exit status."""
    return ended_quietly(_command)


def _command() -> int:
    name = sys.argv[1] if len(sys.argv) > 1 else ""
    if name in ("", "-h", "--help"):
        width = max(map(len, COMMANDS))
        print("usage: tinyekf COMMAND ...\n")
        print("\n".join(f"  {command:{width}}  {what}" for command, (_, what) in COMMANDS.items()))
        print("\ntinyekf COMMAND --help says more; tinyekf --version says which this is.")
        return 0 if name else 2
    if name == "--version":
        print(f"tinyekf {_version()}")
        return 0
    if name not in COMMANDS:
        from difflib import get_close_matches

        nearest = get_close_matches(name, COMMANDS, 1)
        hint = f"did you mean {nearest[0]}?" if nearest else f"there are {', '.join(COMMANDS)}"
        print(f"tinyekf: no command {name!r}; {hint}", file=sys.stderr)
        return 2
    status: int = importlib.import_module(COMMANDS[name][0]).main(sys.argv[2:])
    return status


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("tinyekf-py")
    except PackageNotFoundError:
        return "unknown: run from a folder, not installed"


if __name__ == "__main__":
    sys.exit(main())

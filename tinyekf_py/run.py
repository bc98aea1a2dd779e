"""The main program: `tinyekf run`, live on real or simulated devices, or a replay.

Exit status: 0 done, 1 the run failed or a file lacks its end, 2 the command line or the configuration is wrong
(one line on stderr).
"""

from __future__ import annotations

import argparse
import logging
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from acquisition.background_file import UnfinishedFileError
from acquisition.device import DeviceError
from acquisition.recording import RecordingError, read_recording
from acquisition.recording_writer import set_aside, truth_beside
from acquisition.simulator.scenarios import ScenarioError
from tinyekf_py.command_line import OneLineParser, complain, positive_seconds
from tinyekf_py.config import METHODS, Config, ConfigError, apply_flat, config_text, load_config
from tinyekf_py.console import ConsoleView
from tinyekf_py.console_keys import ConsoleKeys
from tinyekf_py.estimate import Estimate
from tinyekf_py.heading_csv import HeadingCsvError, write_heading_csv
from tinyekf_py.live import LiveRun
from tinyekf_py.outputs.launcher import OutputProcess
from tinyekf_py.outputs.settings import switched_on
from tinyekf_py.program_log import start_program_log
from tinyekf_py.quiet_end import ended_quietly
from tinyekf_py.replay import Replay
from tinyekf_py.simulated_devices import SimulatedDevices, SimulationError
from tinyekf_py.watched_replay import WatchedReplay

DEFAULT_CONFIG = Path("tinyekf.toml")
PROGRESS_PERIOD_S = 2.0
FRAME_PERIOD_S = 0.05  # shortest time between two frames of a fast replay for the outputs
#: Flag, the table of the configuration that it switches on, and what that serves.
SERVED = (
    ("--web", "outputs.web", "the live page"),
    ("--nmea-tcp", "outputs.nmea_tcp", "NMEA 0183 by TCP"),
    ("--signalk", "outputs.signalk", "Signal K deltas by TCP"),
)

_log = logging.getLogger(__name__)


def _parser() -> OneLineParser:
    parser = OneLineParser(prog="tinyekf run", description="Heading from GPS receivers, a compass and an IMU.")
    parser.add_argument("--config", type=Path, metavar="FILE", help=f"configuration (default: ./{DEFAULT_CONFIG})")
    parser.add_argument("--print-config", action="store_true", help="print a documented configuration and end")
    parser.add_argument("--simulate", action="store_true", help="run on five simulated devices")
    parser.add_argument("--scenario", metavar="S", help="with --simulate: what is sailed (tinyekf simulate --list)")
    parser.add_argument("--seed", type=int, metavar="N", help="with --simulate: of all that is random")
    parser.add_argument("--replay", nargs="+", type=Path, metavar="REC", help="replay a recording (its pieces)")
    parser.add_argument("--speed", type=float, metavar="X", help="with --replay: X times real time, with the console")
    parser.add_argument("--record", type=Path, metavar="REC", help="record every line received")
    parser.add_argument("--output", type=Path, metavar="CSV", help="write the heading CSV")
    for flag, table, what in SERVED:
        parser.add_argument(
            flag, nargs="?", type=int, const=True, metavar="PORT", help=f"serve {what} on PORT (default: {table}.port)"
        )
    parser.add_argument("--method", metavar="M", help=f"one of {', '.join(METHODS)}")
    parser.add_argument("--duration", type=positive_seconds, metavar="SECONDS", help="end after this long")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; the exit status."""
    start_program_log()
    parser = _parser()
    try:
        options = parser.parse_args(argv)
        _check(parser, options)
        if options.print_config:
            print(config_text(_config(options)), end="")
            return 0
        return _replay(options) if options.replay else _live(options)
    except (ConfigError, RecordingError, HeadingCsvError, DeviceError, ScenarioError, SimulationError) as error:
        return complain("run", error)
    except UnfinishedFileError as error:
        return complain("run", error, 1)


def _check(parser: OneLineParser, options: argparse.Namespace) -> None:
    if options.replay and (options.simulate or options.record):
        parser.error("--replay goes with neither --simulate nor --record")
    for path in options.replay or ():
        if not path.exists():
            parser.error(f"cannot read recording {path}: No such file or directory")
    if options.speed is not None and not (options.replay and options.speed >= 0.001):
        parser.error("--speed takes a number of at least 0.001, with --replay")
    if not options.simulate and (options.scenario is not None or options.seed is not None):
        parser.error("--scenario and --seed go with --simulate")
    if options.replay and options.output is None and options.speed is None:
        parser.error("--replay needs --output CSV (or --speed 1, to watch it)")
    if options.replay and options.speed is None and _served(options):
        parser.error(f"{', '.join(flag for flag, _, _ in SERVED)} go with a live run, or with --replay at a --speed")
    if options.replay and options.speed is None and options.duration is not None:
        parser.error("--duration goes with a live run, or with --replay at a --speed")
    if options.replay and options.output and any(_is_one_file(options.output, path) for path in options.replay):
        parser.error(f"--output {options.output} would overwrite the recording that is replayed")


def _served(options: argparse.Namespace) -> dict[str, object]:
    """The keys of the configuration that switch on what the command line wants served."""
    flat: dict[str, object] = {}
    for flag, table, _ in SERVED:
        port = getattr(options, flag.removeprefix("--").replace("-", "_"))
        if port is not None:
            flat[f"{table}.enabled"] = True
        if port is not None and port is not True:
            flat[f"{table}.port"] = port
    return flat


def _is_one_file(a: Path, b: Path) -> bool:
    """Whether what is written to `a` would end in `b`; /dev/null takes any number."""
    return a.resolve() == b.resolve() and (a.is_file() or not a.exists())


def _config(options: argparse.Namespace) -> Config:
    if options.config is not None:
        config = load_config(options.config)
    elif DEFAULT_CONFIG.exists() and not options.simulate and not options.print_config:
        config = load_config(DEFAULT_CONFIG)
    else:
        config = Config()
    flat = _served(options)
    if options.method is not None:
        flat["fusion.method"] = options.method
    if options.record is not None:
        flat["outputs.recording"] = str(options.record)
    if options.output is not None:
        flat["outputs.csv"] = str(options.output)
    return apply_flat(config, flat, "the command line")


def _on_signal(end: Callable[[], None]) -> None:
    """Call `end`, which must be quick, when Ctrl-C, SIGTERM or SIGHUP asks the program to end."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda _number, _frame: end())


def _live(options: argparse.Namespace) -> int:
    ended_early = threading.Event()  # by a signal before there is a live run
    _on_signal(ended_early.set)
    config = _config(options)
    if options.config is None and not options.simulate and not DEFAULT_CONFIG.exists():
        _log.info("no ./%s: using the defaults (tinyekf run --print-config shows them)", DEFAULT_CONFIG)
    outputs = config.outputs
    if outputs.recording and outputs.csv and _is_one_file(Path(outputs.csv), Path(outputs.recording)):
        raise ConfigError(f"the recording and the heading CSV cannot be one file, {outputs.csv}")
    start_us = time.monotonic_ns() // 1000
    if not options.simulate:
        return _run_live(LiveRun(config, start_us=start_us), options, ended_early)
    recording = Path(outputs.recording)
    truth = truth_beside(recording) if recording.name and recording.parent.is_dir() else None
    if truth is not None:  # what stood there belongs to the earlier recording
        set_aside(recording)
        if truth.exists():
            raise ConfigError(f"the truth of the simulation would overwrite {truth}; give the recording another name")
    wanted = ["--scenario", options.scenario] if options.scenario is not None else []
    wanted += ["--seed", str(options.seed)] if options.seed is not None else []
    with SimulatedDevices(wanted, truth=truth, start_us=start_us) as devices:
        live = LiveRun(devices.configure(config), start_us=start_us, simulated=True)
        return _run_live(live, options, ended_early)


def _run_live(live: LiveRun, options: argparse.Namespace, ended_early: threading.Event) -> int:
    _on_signal(live.stop)
    if ended_early.is_set():
        live.stop()
    view = ConsoleView()
    with (
        _logging_to(live.notices, quiet=view.takes_terminal and sys.stderr.isatty()),
        ConsoleKeys(live.key_pressed if view.takes_terminal else None),
    ):
        live.run(options.duration, view)
    return 0


class _NoticeHandler(logging.Handler):
    """Shows log lines on the console's screen."""

    def __init__(self, notices: deque[str]) -> None:
        super().__init__()
        self._notices = notices

    def emit(self, record: logging.LogRecord) -> None:
        self._notices.append(record.getMessage().splitlines()[0])


@contextmanager
def _logging_to(notices: deque[str], *, quiet: bool) -> Iterator[None]:
    """Log to `notices` too; `quiet`: to them alone, since the console has the terminal."""
    root = logging.getLogger()
    before = root.handlers[:]
    root.handlers = [_NoticeHandler(notices)] if quiet else [*before, _NoticeHandler(notices)]
    try:
        yield
    finally:
        root.handlers = before


def _replay(options: argparse.Namespace) -> int:
    reader = read_recording(options.replay)
    replay = Replay(reader, method=options.method, config=load_config(options.config) if options.config else None)
    if options.speed is not None:
        _watch(replay, options)
    else:
        write_heading_csv(options.output, _rows(replay), replay.fusion.n_gps)
    for notice in replay.fusion.take_notices():
        _log.warning("%s", notice)
    for loss in replay.losses():
        _log.warning("%s", loss)
    return 0


def _rows(replay: Replay) -> Iterator[Estimate]:
    """The rows of a replay; a long one tells how far it is."""
    reader = replay.reader
    next_at = time.monotonic() + PROGRESS_PERIOD_S
    for rows in replay:
        yield from rows
        if time.monotonic() >= next_at:
            next_at = time.monotonic() + PROGRESS_PERIOD_S
            _log.info("replayed %.0f %%", 100.0 * reader.bytes_read / max(reader.bytes_total, 1))


def _watch(replay: Replay, options: argparse.Namespace) -> None:
    """Replay at a pace, with the console and the outputs."""
    ended = threading.Event()
    _on_signal(ended.set)
    outputs = switched_on(apply_flat(replay.config, _served(options), "the command line").outputs)
    watched = WatchedReplay(replay)
    with ExitStack() as stack:
        view = stack.enter_context(ConsoleView())
        process = stack.enter_context(OutputProcess(outputs, watched.answer)) if outputs else None

        def rows() -> Iterator[Estimate]:
            began = time.monotonic()
            next_frame = 0.0
            for row in watched.rows(options.speed, ended.wait):
                now = time.monotonic()
                if now >= next_frame:
                    next_frame = now + FRAME_PERIOD_S
                    state = watched.view_state()
                    view.show(state)
                    if process is not None:
                        process.offer(state)
                yield row
                if options.duration is not None and now - began >= options.duration:
                    return

        if options.output is not None:
            write_heading_csv(options.output, rows(), replay.fusion.n_gps)
        else:
            for _ in rows():
                pass


if __name__ == "__main__":
    sys.exit(ended_quietly(main))

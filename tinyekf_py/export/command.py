"""`tinyekf export REC --csv|--parquet|--mcap`: samples and estimates of a recording, for other tools.

Exit status: 0 done, 1 the export could not be written, 2 the command line, the configuration or the recording is
wrong (one line on stderr).
"""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from acquisition.recording import Event, RecordingError, read_recording
from tinyekf_py.command_line import OneLineParser, complain
from tinyekf_py.config import METHODS, ConfigError, load_config
from tinyekf_py.export.csv_tables import CsvTables
from tinyekf_py.export.part_files import PartFiles
from tinyekf_py.export.tables import ExportError, Sink, Table, sample_table, samples_by_source
from tinyekf_py.program_log import start_program_log
from tinyekf_py.replay import Replay

PROGRESS_PERIOD_S = 2.0

_log = logging.getLogger(__name__)


def _parser() -> OneLineParser:
    parser = OneLineParser(prog="tinyekf export", description="A recording as tables for other tools.")
    parser.add_argument("recordings", nargs="+", type=Path, metavar="REC", help="a recording (its pieces)")
    kinds = parser.add_mutually_exclusive_group(required=True)
    for kind, what in (
        ("csv", "a folder with a file for each sensor, and heading.csv"),
        ("parquet", "the same as Parquet; needs the extra [parquet]"),
        ("mcap", "one file that opens in Foxglove; needs the extra [mcap]"),
    ):
        kinds.add_argument(f"--{kind}", dest="kind", action="store_const", const=kind, help=what)
    parser.add_argument(
        "--output", type=Path, metavar="PATH", help="the folder or file (default: beside the recording)"
    )
    parser.add_argument("--method", choices=METHODS, metavar="M", help=f"one of {', '.join(METHODS)}")
    parser.add_argument("--config", type=Path, metavar="FILE", help="in place of the recording's own")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; the exit status."""
    start_program_log()
    options = _parser().parse_args(argv)
    try:
        config = load_config(options.config) if options.config else None
        replay = Replay(read_recording(options.recordings), method=options.method, config=config)
        output = options.output or _default_output(options.recordings[0], options.kind)
        _export(replay, options.kind, output, options.recordings)
    except (RecordingError, ConfigError, ExportError) as error:
        return complain("export", error)
    except OSError as error:
        print(f"tinyekf export: cannot write: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 1
    for loss in replay.losses():
        _log.warning("%s", loss)
    print(output)
    return 0


def _default_output(recording: Path, kind: str) -> Path:
    """today.log and today.log.gz give today.mcap, or a folder today-csv."""
    name = recording.name.removesuffix(".gz")
    stem = Path(name).stem or name
    return recording.with_name(f"{stem}.mcap" if kind == "mcap" else f"{stem}-{kind}")


def _export(replay: Replay, kind: str, output: Path, recordings: Sequence[Path]) -> None:
    with PartFiles(recordings) as files, ExitStack() as stack:
        sink = _sink(replay, kind, output, files, stack)
        tables: dict[int, Table] = {}
        reader = replay.reader
        next_at = time.monotonic() + PROGRESS_PERIOD_S
        for part in replay.parts():
            if isinstance(part, Event):
                sink.estimates(replay.fusion.obey(part))
                continue
            for source, rows in samples_by_source(part).items():
                if source not in tables:
                    tables[source] = sample_table(source)
                sink.samples(tables[source], rows)
            sink.estimates(replay.fusion.feed_records(part))
            if time.monotonic() >= next_at:
                next_at = time.monotonic() + PROGRESS_PERIOD_S
                _log.info("exported %.0f %%", 100.0 * reader.bytes_read / max(reader.bytes_total, 1))


def _sink(replay: Replay, kind: str, output: Path, files: PartFiles, stack: ExitStack) -> Sink:
    n_gps, start_utc = replay.fusion.n_gps, replay.reader.start_utc
    if kind == "mcap":
        if output.is_dir():
            raise ExportError(f"{output} is a folder; give a file")
        try:
            from tinyekf_py.export.mcap_channels import McapChannels
        except ImportError as error:
            raise ExportError(f"--mcap needs {error.name}; install the extra [mcap]") from error
        return McapChannels(output, files, stack, n_gps, start_utc)
    if output.exists() and not output.is_dir():
        raise ExportError(f"{output} is a file; give a folder")
    if kind == "csv":
        output.mkdir(parents=True, exist_ok=True)
        return CsvTables(output, files, stack, n_gps)
    try:
        from tinyekf_py.export.parquet_tables import ParquetTables
    except ImportError as error:
        raise ExportError(f"--parquet needs {error.name}; install the extra [parquet]") from error
    output.mkdir(parents=True, exist_ok=True)
    return ParquetTables(output, files, stack, n_gps, start_utc)


if __name__ == "__main__":
    sys.exit(main())

"""Writes a recording (`recording` says in which form) as the live program feeds its fusion, without holding it up."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

from acquisition.background_file import ONE_PIECE, BackgroundFile, Rotation, pieces_of
from acquisition.recording import MAGIC, VERSION, RecordingError, escape, format_seconds, read_recording
from acquisition.toml_value import toml_value

_log = logging.getLogger(__name__)


class RecordingWriter:
    """Writes a recording without ever making its caller wait or fail (`background_file` says how).

    An earlier recording of that name is set aside under its start, `today.20261124T030000Z.log`; any other file with
    something in it is a RecordingError, and left alone. `config` are the flat keys that shape the result, as
    `#config` lines.
    """

    def __init__(
        self,
        path: str | Path,
        start_utc: datetime,
        config: Mapping[str, object],
        rotation: Rotation = ONE_PIECE,
    ) -> None:
        if str(path).endswith(".gz"):
            raise RecordingError(f"cannot record to {path}: a compressed file does not survive a power cut; omit .gz")
        started = start_utc.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
        header = [f"{MAGIC.decode()}{VERSION}", f"#start {started}"]
        header += [f"#config {key}={toml_value(value)}" for key, value in config.items()]
        text = ("\n".join(header) + "\n").encode("utf-8", "replace")
        stopped: dict[str, None] = {}

        def render(entries: list[_Entry]) -> bytes:
            for _, verb, name in entries:
                if isinstance(name, str) and verb == "stop":
                    stopped[name] = None
                elif isinstance(name, str) and verb == "start":
                    stopped.pop(name, None)
            return _render(entries)

        def continued() -> bytes:
            """The header of a further piece: it must do without those before it, which may be removed."""
            return text + f"#config tasks.stopped={toml_value(list(stopped))}\n".encode()

        try:
            set_aside(Path(path))
            self._file = BackgroundFile(path, text, render, rotation=rotation, continued=continued, gap=_gap)
        except OSError as error:
            raise RecordingError(f"cannot record to {path}: {error.strerror}") from error

    @property
    def path(self) -> Path:
        return self._file.path

    @property
    def failure(self) -> str:
        """Why recording has stopped, one line; empty while it goes on."""
        return self._file.failure

    @property
    def lost(self) -> int:
        """Lines and events that were not recorded."""
        return self._file.lost

    def line(self, t_us: int, source: str, line: bytes) -> None:
        """Record `line`, received at `t_us` microseconds since the start."""
        self._file.put((t_us, source, line))

    def event(self, t_us: int, verb: str, name: str) -> None:
        """Record what was done to task or source `name` (an `EVENT_VERBS`), `t_us` microseconds since the start."""
        self._file.put((t_us, verb, name))

    def flush(self) -> None:
        """Wait until all of it is on the disk (or recording has failed)."""
        self._file.flush()

    def close(self) -> None:
        """Write the rest and end; harmless when repeated. UnfinishedFileError when the recording lacks its end."""
        self._file.close()


_Entry = tuple[int, str, bytes] | tuple[int, str, str]


def truth_beside(path: Path) -> Path:
    """Where the truth of a simulated recording is: `r.truth.csv` beside `r.log` or `r.log.gz`."""
    plain = path.with_suffix("") if path.suffix == ".gz" else path
    return plain.with_suffix(".truth.csv")


def set_aside(path: Path) -> None:
    """Rename an earlier recording at `path`, what is left of its pieces and its truth: a restart costs no voyage."""
    if path.exists() and not path.is_file():
        return  # a device or a pipe
    old = [piece for piece in (path, *pieces_of(path)) if piece.is_file() and piece.stat().st_size > 0]
    if not old:
        return
    try:
        started = read_recording(old).start_utc or datetime.fromtimestamp(old[0].stat().st_mtime, UTC)
    except RecordingError as error:
        raise RecordingError(f"cannot record to {path}: what is there is no recording; give another name") from error
    name = stem = f"{path.stem}.{started:%Y%m%dT%H%M%SZ}"
    number = 1
    while path.with_name(name + path.suffix).exists():
        number += 1
        name = f"{stem}-{number}"
    try:
        for piece in (*old, *filter(Path.exists, [truth_beside(path)])):
            piece.rename(piece.with_name(name + piece.name.removeprefix(path.stem)))
    except OSError as error:
        raise RecordingError(f"cannot set the earlier recording {path} aside: {error.strerror}") from error
    _log.info("the earlier recording %s is now %s", path, name + path.suffix)


def _gap(lost: int, why: str) -> bytes:
    return f"# {lost} entries are missing here: {why}\n".encode()


def _render(entries: list[_Entry]) -> bytes:
    texts = []
    for t_us, word, rest in entries:
        stamp = format_seconds(t_us)
        if isinstance(rest, bytes):
            texts.append(b"%b %b %b\n" % (stamp.encode(), word.encode(), escape(rest)))
        else:
            texts.append(f"#event {stamp} {word} {rest}\n".encode())
    return b"".join(texts)

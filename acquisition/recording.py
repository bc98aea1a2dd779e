r"""Recordings: every line a device sent, with its stamp, in the order in which fusion processed it.

The format is text and append-only, so that a power cut costs at most the last second and a sailor can read it::

    #tinyekf-recording 1
    #start 2026-11-24T03:00:00.000000Z
    #config fusion.method="cnw3"
    0.068566 gps1 $GPGGA,030000.00,3557.60156,N,12631.19962,E,2,08,1.04,12.3,M,25.1,M,,*65
    #event 12.345678 stop gps2

Seconds since the start with six decimals, the source, the line as received without its ending; bytes outside
0x20-0x7E and the backslash as ``\xHH``. The live program writes one (`recording_writer`); a replay reads one, or the
pieces of a rotated set, with `read_recording`. Reading drops what is damaged, counts it by reason, and goes on.
"""

from __future__ import annotations

import gzip
import re
import statistics
import tomllib
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from io import BufferedReader
from pathlib import Path
from typing import NamedTuple

from acquisition.sample import SOURCES

MAGIC = b"#tinyekf-recording "
VERSION = 1
EVENT_VERBS = ("start", "stop", "restart", "lost")
MAX_LINE = 1024  # bytes of a device's line
MAX_JUMP_US = 60_000_000  # ahead, believed at once
DAY_US = 86_400_000_000

_MAX_TEXT = 4 * MAX_LINE + 64  # bytes of a recorded line: each byte escaped, and the stamp and source before it
_CHUNK = 1 << 18
_BEGINNING_LINES = 500  # read for the header and the first stamps
_GZIP_MAGIC = b"\x1f\x8b"
_NOT_PLAIN = re.compile(rb"[^\x20-\x5b\x5d-\x7e]")
_SOURCE_OF = {name.encode(): name for name in SOURCES}


class RecordingError(ValueError):
    """A recording that cannot be read or written: one line saying which, where and why."""


class Line(NamedTuple):
    """A line of a device."""

    t_us: int  #: microseconds since the recording's start
    source: str
    line: bytes


class Event(NamedTuple):
    """A task that was started, stopped or restarted, or a source whose port hung up."""

    t_us: int  #: microseconds since the recording's start
    verb: str
    name: str


def escape(line: bytes) -> bytes:
    r"""`line` with every byte outside 0x20-0x7E, and the backslash, written as ``\xHH``."""
    return _NOT_PLAIN.sub(lambda match: b"\\x%02X" % match[0][0], line)


def unescape(text: bytes) -> bytes:
    r"""The bytes that `escape` wrote; ValueError for a backslash that does not begin a ``\xHH``."""
    # unicode_escape does the work in C, but knows more escapes than this format has: these are refused beforehand.
    if text.count(b"\\") != text.count(b"\\x"):
        raise ValueError("a backslash must be written as \\x5C")
    return text.decode("unicode_escape").encode("latin-1")


def format_seconds(t_us: int) -> str:
    """Microseconds as seconds with six decimals, exactly."""
    seconds, rest = divmod(t_us, 1_000_000)
    return f"{seconds}.{rest:06d}"


def parse_seconds(text: bytes) -> int:
    """Microseconds of unsigned decimal seconds with at most six decimals, exactly; ValueError otherwise."""
    whole, _, fraction = text.partition(b".")
    if not whole.isdigit() or len(whole) > 12 or len(fraction) > 6 or not (fraction + b"0").isdigit():
        raise ValueError(f"not a stamp in seconds: {text[:20]!r}")
    return int(whole) * 1_000_000 + int(fraction.ljust(6, b"0"))


def read_recording(paths: str | Path | Sequence[str | Path]) -> RecordingReader:
    """A reader of one recording: a file, plain or gzip, or the pieces of a rotated set in any order.

    Headers are read at once: RecordingError says which file is missing, unreadable, or no recording.
    """
    return RecordingReader([paths] if isinstance(paths, str | Path) else list(paths))


class RecordingReader:
    """Iterates the `Line` and `Event` entries of a recording, from the start each time it is iterated.

    `dropped` counts what was left out, by reason: "cut last line", "malformed", "unknown source", "backwards" (over
    a day before the beginning), "forward jump" (of more than a minute, alone), "damaged gzip" (the rest of that
    file). A replay adds "unknown task". Smaller steps back are kept: after a stall of the live program the lines of
    one device stand behind later ones of another, and what is too old among them the fusion refuses, live and
    replayed.
    """

    def __init__(self, paths: Sequence[str | Path]) -> None:
        if not paths:
            raise RecordingError("no recording was named")
        named = [Path(path).resolve() for path in paths]
        twice = next((path for path, one in zip(paths, named, strict=True) if named.count(one) > 1), None)
        if twice is not None:
            raise RecordingError(f"{twice} is named twice; name each piece of a recording once")
        pieces = [_Piece(Path(path), continued=len(paths) > 1) for path in paths]
        pieces.sort(key=lambda piece: piece.first_us)
        starts = {piece.start_utc for piece in pieces if piece.start_utc is not None}
        if len(starts) > 1:
            begun = ", ".join(f"{piece.path} at {piece.start_utc:%FT%T}" for piece in pieces if piece.start_utc)
            raise RecordingError(f"not the pieces of one recording, they start at different times: {begun}")
        if not any(piece.has_header for piece in pieces):
            raise _not_a_recording(pieces[0].path)
        self._pieces = pieces
        #: When the recording began, by the recording computer's clock (UTC); None where no `#start` says it.
        self.start_utc: datetime | None = next(iter(starts), None)
        #: The flat `#config` keys of the first piece that has any, values as TOML gives them.
        self.config: dict[str, object] = next((piece.config for piece in pieces if piece.config), {})
        self.dropped: Counter[str] = Counter()
        #: Bytes of the files (of the compressed ones for gzip) read so far, and in all.
        self.bytes_read = 0
        self.bytes_total = sum(piece.size for piece in pieces)

    def __iter__(self) -> Iterator[Line | Event]:
        self.dropped.clear()
        self.bytes_read = 0
        # A stamp far ahead is believed when the next one is there too: a silence, not a damaged digit.
        latest, limit, lowest = -1, MAX_JUMP_US, self._pieces[0].first_us - DAY_US
        held: Line | Event | None = None
        source_of, new_line, dropped = _SOURCE_OF, tuple.__new__, self.dropped
        for text in self._texts():
            # Runs for every line of hours of recording: the good line takes the shortest way.
            entry: Line | Event
            if text[:1] == b"#":
                if not text.startswith(b"#event "):
                    continue
                event = _parse_event(text)
                if event is None:
                    dropped["malformed"] += 1
                    continue
                entry, t_us = event, event.t_us
            else:
                try:
                    stamp, name, line = text.split(b" ", 2)
                    digits = stamp.replace(b".", b"", 1)
                    t_us = int(digits) if stamp[-7:-6] == b"." and digits.isdigit() else parse_seconds(stamp)
                    if b"\\" in line:
                        line = unescape(line)
                except ValueError:
                    if text:
                        dropped["malformed"] += 1
                    continue
                source = source_of.get(name)
                if source is None or len(line) > MAX_LINE:
                    dropped["unknown source" if source is None else "malformed"] += 1
                    continue
                entry = new_line(Line, (t_us, source, line))
            if t_us < lowest:
                dropped["backwards"] += 1
                continue
            if held is not None:
                if t_us >= held[0] - MAX_JUMP_US:
                    latest = held[0]
                    limit = latest + MAX_JUMP_US
                    yield held
                else:
                    dropped["forward jump"] += 1
                held = None
            if t_us > latest:
                if t_us > limit:
                    held = entry
                    continue
                latest, limit = t_us, t_us + MAX_JUMP_US
            yield entry
        if held is not None:  # nothing came after it to tell
            if held[0] <= latest + DAY_US:
                yield held
            else:
                dropped["forward jump"] += 1

    def _texts(self) -> Iterator[bytes]:
        for piece in self._pieces:
            read_before = self.bytes_read
            for texts, position in piece.texts(self.dropped):
                self.bytes_read = read_before + position
                yield from texts
            self.bytes_read = read_before + piece.size


class _Piece:
    """One file of a recording, its header read."""

    def __init__(self, path: Path, *, continued: bool) -> None:
        self.path = path
        self.start_utc: datetime | None = None
        self.config: dict[str, object] = {}
        #: What the first stamps agree on (their median), microseconds; later than any stamp when there is none.
        self.first_us = 1 << 62
        try:
            self.size = path.stat().st_size
        except OSError as error:
            raise RecordingError(f"cannot read recording {path}: {error.strerror}") from error
        beginning: list[bytes] = []
        damage: Counter[str] = Counter()
        for texts, _ in self.texts(damage):
            beginning += texts
            if len(beginning) > _BEGINNING_LINES:
                break
        if damage["damaged gzip"] and not beginning:
            raise RecordingError(f"cannot read recording {path}: its gzip is damaged from the beginning")
        self.has_header = bool(beginning) and beginning[0].startswith(MAGIC)
        stamps = _first_stamps(beginning)
        if stamps:
            self.first_us = statistics.median_low(stamps)
        if self.has_header:
            self._read_header(beginning)
        elif not (continued and stamps):  # a recording cut by size has its header in its first piece alone
            raise _not_a_recording(path)

    def _read_header(self, beginning: list[bytes]) -> None:
        version = beginning[0].removeprefix(MAGIC).strip()
        if version != str(VERSION).encode():
            told = version.decode("ascii", "replace")
            raise RecordingError(f"{self.path} is a recording of version {told}; this program reads version {VERSION}")
        for number, text in enumerate(beginning[1:], 2):
            if text and not text.startswith(b"#"):
                return
            word, _, rest = text.decode("utf-8", "replace").partition(" ")
            try:
                if word == "#start":
                    start = datetime.fromisoformat(rest.strip())
                    self.start_utc = start.replace(tzinfo=start.tzinfo or UTC).astimezone(UTC)
                elif word == "#config":
                    key, equals, value = rest.partition("=")
                    if not equals:
                        raise ValueError("no = in it")
                    self.config[key.strip()] = tomllib.loads(f"value = {value}")["value"]
            except (ValueError, OverflowError, RecursionError) as error:
                raise RecordingError(f"{self.path}, line {number}: malformed {word} line: {error}") from error

    def texts(self, dropped: Counter[str]) -> Iterator[tuple[list[bytes], int]]:
        """Complete lines, a chunk of the file at a time, each with the position reached in the file (bytes)."""
        rest = b""
        skipping = False  # inside a line too long to be one
        try:
            with self.path.open("rb") as file, _plain(file) as plain:
                while chunk := plain.read1(_CHUNK):  # read() would lose what precedes the cut of a gzip file
                    chunk = rest + chunk
                    if b"\r\n" in chunk:  # a recording that went through an editor of another system
                        chunk = chunk.replace(b"\r\n", b"\n")
                    lines = chunk.split(b"\n")
                    rest = lines.pop()
                    if skipping and lines:
                        del lines[0]
                        skipping = False
                    if len(rest) > _MAX_TEXT:
                        dropped["malformed"] += not skipping
                        skipping, rest = True, b""
                    yield lines, file.tell()
        except EOFError:  # the end of a gzip file was never written, as after a power cut
            rest = rest or b"cut"
        except (gzip.BadGzipFile, zlib.error):
            dropped["damaged gzip"] += 1
            return
        except OSError as error:
            raise RecordingError(f"cannot read recording {self.path}: {error.strerror or error}") from error
        if rest and not skipping:
            dropped["cut last line"] += 1


def _plain(file: BufferedReader) -> BufferedReader | gzip.GzipFile:
    beginning = file.read(2)
    file.seek(0)
    return gzip.GzipFile(fileobj=file) if beginning == _GZIP_MAGIC else file


def _not_a_recording(path: Path) -> RecordingError:
    return RecordingError(f"{path} is not a recording: it does not begin with {MAGIC.decode()}{VERSION}")


def _first_stamps(texts: list[bytes], wanted: int = 9) -> list[int]:
    stamps: list[int] = []
    for text in texts:
        stamp, _, _ = text.removeprefix(b"#event ").partition(b" ")
        try:
            stamps.append(parse_seconds(stamp))
        except ValueError:
            continue
        if len(stamps) == wanted:
            break
    return stamps


def _parse_event(text: bytes) -> Event | None:
    try:
        _, stamp, verb, name = text.decode("ascii").split()
        return Event(parse_seconds(stamp.encode()), verb, name) if verb in EVENT_VERBS else None
    except ValueError:
        return None

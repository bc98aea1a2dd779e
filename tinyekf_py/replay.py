"""Replay: a recording through the same decoders and the same fusion as live, as fast as it goes or at a chosen pace.

What a live run wrote into its heading CSV, the replay of its recording writes again, byte for byte: decoders and
fusion are pure functions of what they are fed, and the recording holds exactly that.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from acquisition.decoder import Decoder, make_decoder
from acquisition.recording import Event, Line, RecordingReader, read_recording
from acquisition.sample import SOURCES
from tinyekf_py.config import Config, apply_flat
from tinyekf_py.estimate import Estimate
from tinyekf_py.fusion import STAGES, HeadingFusion, fusion_of
from tinyekf_py.tasks import Tasks, task_names

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_BATCH = 2000  # samples fed at a time


def replay(
    path: str | Path | Sequence[str | Path], method: str | None = None, config: Config | None = None
) -> NDArray[np.void]:
    """The heading CSV's rows of a recording (or of the files of a rotated one) as a structured array.

    `config` replaces the recording's own; `method` replaces that of either. RecordingError or ConfigError say in one
    line what is wrong with either.
    """
    from tinyekf_py.estimate_array import estimates_to_array  # NumPy is dear to start; a replay to a file needs none

    run = Replay(read_recording(path), method=method, config=config)
    return estimates_to_array((row for rows in run for row in rows), run.fusion.n_gps)


class Replay:
    """One pass over a recording: iterate it for the rows, a batch at a time.

    `fusion` and `counts` (lines of each source that gave nothing, by reason) are worth a look afterwards.
    """

    def __init__(self, reader: RecordingReader, *, method: str | None = None, config: Config | None = None) -> None:
        if config is None:
            config = apply_flat(Config(), reader.config, "the recording's #config lines")
        if method is not None:
            config = apply_flat(config, {"fusion.method": method}, "--method")
        self.reader = reader
        self.config = config
        self.fusion: HeadingFusion = fusion_of(config)
        for name in Tasks(task_names(config.sources, config.n_gps), config.tasks.stopped).stopped:
            self.fusion.set_task(0, name, running=False)
        self._decoders: dict[str, Decoder] = {}
        for name in config.sources:
            self._renew(name)

    @property
    def counts(self) -> Mapping[str, Counter[str]]:
        """What became of each source's lines, by its name: "lines", "samples", and one key for each reason."""
        return {name: decoder.counts for name, decoder in self._decoders.items()}

    def losses(self) -> Iterator[str]:
        """What was dropped, one line for the recording and each source of which something was."""
        for source, counts in {"recording": self.reader.dropped, **self.counts}.items():
            dropped = {reason: n for reason, n in counts.items() if n and reason not in ("lines", "samples", "unused")}
            if dropped:
                yield f"{source}: dropped {', '.join(f'{n} {reason}' for reason, n in dropped.items())}"

    def _renew(self, name: str) -> None:
        sensor = self.config.sensors[name]
        counts = self._decoders[name].counts if name in self._decoders else None
        self._decoders[name] = make_decoder(name, sensor.driver, self.config.decoder_options(name))
        if counts is not None:
            self._decoders[name].counts.update(counts)

    def __iter__(self) -> Iterator[list[Estimate]]:
        """Lists of rows, oldest first, as they fall due."""
        for part in self.parts():
            yield self.fusion.obey(part) if isinstance(part, Event) else self.fusion.feed_records(part)

    def parts(self) -> Iterator[bytes | Event]:
        """What fusion is to be fed, in order: packed samples, many at a time, and the events between them."""
        records: list[bytes] = []
        decode_of = {name: decoder.decode for name, decoder in self._decoders.items()}
        for entry in self.reader:
            if type(entry) is Line:
                decode = decode_of.get(entry[1])
                if decode is None:
                    continue
                for sample in decode(entry[0], entry[2]):
                    records.append(sample.pack())
                if len(records) >= _BATCH:
                    yield b"".join(records)
                    records.clear()
            elif isinstance(entry, Event):
                yield b"".join(records)
                records.clear()
                if entry.verb == "restart":
                    self._restart(entry.name)
                    decode_of = {name: decoder.decode for name, decoder in self._decoders.items()}
                elif self._knows(entry):
                    yield entry
        yield b"".join(records)

    def _restart(self, name: str) -> None:
        if name in self._decoders:
            self._renew(name)

    def _knows(self, event: Event) -> bool:
        """Whether there is such a task or source; a damaged name is counted among what the reader dropped."""
        known = event.name in SOURCES or (event.name in STAGES and event.verb != "lost")
        self.reader.dropped["unknown task"] += not known
        return known

    def paced(
        self,
        speed: float,
        wait: Callable[[float], bool],
        take: Callable[[str, bytes], None] | None = None,
        obey: Callable[[Event], None] | None = None,
    ) -> Iterator[Estimate]:
        """The rows at `speed` times real time; `wait(seconds)` waits, and says True to end early.

        `take` and `obey` are told of each sensor's samples and of each event once the rows before it are through.
        """
        began = time.monotonic()
        first_us: int | None = None
        for entry in self.reader:
            records = b""
            if isinstance(entry, Event):
                rows = self._obeyed(entry)
            elif entry.source in self._decoders:
                samples = self._decoders[entry.source].decode(entry.t_us, entry.line)
                records = b"".join(sample.pack() for sample in samples)
                rows = self.fusion.feed_records(records) if records else []
            else:
                continue
            for row in rows:
                first_us = row.t_us if first_us is None else first_us
                due = began + (row.t_us - first_us) / 1e6 / speed
                if wait(max(0.0, due - time.monotonic())):
                    return
                yield row
            if isinstance(entry, Event):
                if obey is not None:
                    obey(entry)
            elif records and take is not None:
                take(entry.source, records)

    def _obeyed(self, event: Event) -> list[Estimate]:
        if event.verb == "restart":
            self._restart(event.name)
            return []
        return self.fusion.obey(event) if self._knows(event) else []

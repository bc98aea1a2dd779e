"""atheris on every decoder and the recording reader: nothing raises but what is documented, nothing lies.

    python tests/fuzz/fuzz_decoders.py gps|compass|imu|imu-hex|recording [libFuzzer options] [corpus]

Bytes arrive in chunks of varying length, as from a port, and go through framing and decoder.
"""

from __future__ import annotations

import contextlib
import math
import sys
import tempfile
from pathlib import Path

import atheris

with atheris.instrument_imports():
    from acquisition.decoder import make_decoder
    from acquisition.message import MAX_LINE
    from acquisition.recording import RecordingError, read_recording, unescape
    from acquisition.sample import SAMPLE_SIZE, CompassSample, GpsSample, ImuSample, unpack

TARGETS = {
    "gps": ("gps1", "nmea"),
    "compass": ("compass", "nmea"),
    "imu": ("imu", "ebimu-ascii"),
    "imu-hex": ("imu", "ebimu-hex"),
}
_file = Path(tempfile.mkstemp(prefix="fuzz", suffix=".rec")[1])


def decode(source: str, driver: str, said: bytes) -> None:
    """What a worker does with the bytes of its port."""
    decoder = make_decoder(source, driver, {})
    framing = decoder.framing()
    t_us = 0
    while said:
        length = 1 + said[0] % 61
        t_us += 1000 * said[0]
        lines = framing.feed(said[1 : 1 + length])
        said = said[1 + length :]
        for line in lines:
            assert len(line) <= MAX_LINE
            for sample in decoder.decode(t_us, line):
                packed = sample.pack()
                assert len(packed) == SAMPLE_SIZE
                check(unpack(packed))
    assert all(count >= 0 for count in decoder.counts.values())
    assert "\n" not in decoder.last_error


def check(sample: object) -> None:
    """Every number is missing or possible."""
    if isinstance(sample, GpsSample):
        assert not abs(sample.lat_deg) > 90.0
        assert not abs(sample.lon_deg) > 180.0
        assert not math.isinf(sample.speed_mps)
    elif isinstance(sample, CompassSample):
        heading_deg = sample.heading_deg
        assert math.isnan(heading_deg) or 0.0 <= heading_deg <= 360.0
    elif isinstance(sample, ImuSample):
        assert not any(math.isinf(number) for number in sample[3:])


def read(said: bytes) -> None:
    """A recording of any bytes, as a file."""
    _file.write_bytes(said)
    try:
        reader = read_recording(_file)
        for entry in reader:
            assert entry.t_us >= 0
    except RecordingError as error:
        if "\n" in str(error):
            raise AssertionError("a message of more than one line") from error
    with contextlib.suppress(ValueError):
        unescape(said)


def main() -> None:
    """Fuzz the target that the command line names."""
    target = sys.argv.pop(1)
    one_input = read if target == "recording" else lambda said: decode(*TARGETS[target], said)
    try:
        atheris.Setup(sys.argv, one_input)
        atheris.Fuzz()
    finally:
        _file.unlink(missing_ok=True)


if __name__ == "__main__":
    main()

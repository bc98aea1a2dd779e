"""How much faster than real time a recording replays: from its text, and from decoded samples, for each method.

    python bench/replay.py [SECONDS]

The recording is simulated: five devices at full rates (three GPS of three sentences and a compass of two at 10 Hz, an
IMU at 100 Hz), 600 s unless told otherwise. One core; the shortest of three turns.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from acquisition.decoder import make_decoder
from acquisition.recording import Line, read_recording
from tinyekf_py._core import ffi, lib
from tinyekf_py.config import Config, apply_flat
from tinyekf_py.fusion import METHODS, fusion_of
from tinyekf_py.heading_csv import write_heading_csv
from tinyekf_py.replay import Replay

TURNS = 3


def decoded(path: Path) -> tuple[bytes, Config]:
    reader = read_recording(path)
    config = apply_flat(Config(), reader.config, str(path))
    decoders = {n: make_decoder(n, config.sensors[n].driver, config.decoder_options(n)) for n in config.sources}
    samples = [
        sample.pack()
        for entry in reader
        if isinstance(entry, Line)
        for sample in decoders[entry.source].decode(entry.t_us, entry.line)
    ]
    return b"".join(samples), config


def from_text(path: Path, method: str) -> float:
    began = time.perf_counter()
    replay = Replay(read_recording(path), method=method)
    write_heading_csv(path.with_suffix(".csv"), (row for rows in replay for row in rows), replay.fusion.n_gps)
    return time.perf_counter() - began


def from_samples(records: bytes, config: Config, method: str) -> float:
    """Seconds that the C core takes for all samples and rows, the rows left in C."""
    fusion = fusion_of(apply_flat(config, {"fusion.method": method}, "benchmark"))
    samples, n = ffi.from_buffer("sample_t[]", records), len(records) // ffi.sizeof("sample_t")
    rows, n_rows = ffi.new("estimate_t[]", 100_000), ffi.new("int *")
    began = time.perf_counter()
    fed = lib.fusion_run(fusion._fusion, samples, n, rows, 100_000, n_rows)
    seconds = time.perf_counter() - began
    assert fed == n
    return seconds


def main() -> None:
    duration_s = float(sys.argv[1]) if len(sys.argv) > 1 else 600.0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.log"
        command = [sys.executable, "-m", "acquisition.simulator", str(path), str(path.with_suffix(".truth.csv"))]
        subprocess.run([*command, "--duration", str(duration_s)], check=True)
        records, config = decoded(path)
        print(f"{duration_s:.0f} s of recording, {path.stat().st_size / 1e6:.1f} MB, {len(records) // 112} samples")
        decoded_s = {}
        for method in METHODS:
            text_s = min(from_text(path, method) for _ in range(TURNS))
            decoded_s[method] = min(from_samples(records, config, method) for _ in range(TURNS))
            print(
                f"{method:9} from text {text_s:6.2f} s = {duration_s / text_s:6.0f} x real time;  "
                f"from samples {decoded_s[method] * 1e3:7.1f} ms = {duration_s / decoded_s[method]:8.0f} x"
            )
        print(f"cnw3 : ekf-ci = 1 : {decoded_s['ekf-ci'] / decoded_s['cnw3']:.1f} (the 2019 paper, in MATLAB: 1 : 27)")


if __name__ == "__main__":
    main()

"""Writes the seeds of the fuzzers: good sentences, framed as the targets take their bytes.

python tests/fuzz/make_seeds.py
"""

from __future__ import annotations

from pathlib import Path

from acquisition.sample import CompassSample, GpsSample, ImuSample
from acquisition.simulator.grades import GRADES
from acquisition.simulator.scenarios import SCENARIOS
from acquisition.simulator.voyage import Voyage

CORPUS = Path(__file__).resolve().parent / "corpus"


def chunked(said: bytes) -> bytes:
    """`said` with the byte before each chunk that tells its length."""
    return b"".join(b"\x3c" + said[start : start + 61] for start in range(0, len(said), 61))


def main() -> None:
    """Write them all."""
    voyage = Voyage(SCENARIOS["tour"], GRADES["typical"])
    said: dict[str, bytes] = {"gps1": b"", "compass": b"", "imu": b""}
    recording = b'#tinyekf-recording 1\n#start 2026-11-24T03:00:00.000000Z\n#config fusion.method="cnw3"\n'
    for _ in range(60):
        for t_us, source, line in voyage.advance():
            recording += b"%d.%06d %b %b\n" % (t_us // 1_000_000, t_us % 1_000_000, source.encode(), line)
            if source in said:
                said[source] += line + b"\r\n"
    frame = b"\x55\x55" + bytes(range(18))
    seeds = {
        "gps/epochs": chunked(said["gps1"][:700]),
        "compass/sentences": chunked(said["compass"][:300]),
        "compass/others": chunked(b"$HCHDG,101.1,1.0,E,7.1,W*54\r\n$HEHDT,1.5,T*17\r\n$HETHS,3.2,A*13\r\n"),
        "imu/lines": chunked(said["imu"][:300]),
        "imu-hex/frames": chunked((frame + sum(frame).to_bytes(2, "big")) * 3),
        "recording/short": recording[:1500] + b"#event 0.300000 stop gps2\n0.310000 imu *1\\x41\n",
    }
    nan = float("nan")
    samples = (
        GpsSample(0, 0, 1, 1.8e9, 36.0, 126.5, 0.0, 3.0, 90.0, 1.0, nan, 8),
        CompassSample(40_000, 8, 0, 90.0, nan, nan, nan, nan),
        ImuSample(50_000, 9, 0, 0.0, 0.0, 90.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0),
        GpsSample(100_000, 0, 1, 1.8e9, 36.0, 126.500003, 0.0, 3.0, 90.0, 1.0, nan, 8),
    )
    for method in range(3):
        seeds[f"core/method{method}"] = bytes([method, 0x73]) + b"".join(b"\x20" + s.pack() for s in samples)
    for name, seed in seeds.items():
        (CORPUS / name).parent.mkdir(parents=True, exist_ok=True)
        (CORPUS / name).write_bytes(seed)


if __name__ == "__main__":
    main()

"""Writes the seeds of the fuzzers: good sentences, framed as the targets take their bytes.

python tests/fuzz/make_seeds.py
"""

from __future__ import annotations

from pathlib import Path

from acquisition.sample import GpsSample
from acquisition.simulator.grades import GRADES
from acquisition.simulator.scenarios import SCENARIOS
from acquisition.simulator.voyage import Voyage

CORPUS = Path(__file__).resolve().parent / "corpus"


def chunked(said: bytes) -> bytes:
    """`said` with the byte before each chunk that tells its length."""
    return b"".join(b"\x3c" + said[start : start + 61] for start in range(0, len(said), 61))


def cruise(epochs: int) -> bytes:
    """A boat under way in the short form of `fuzz_fusion.c`: an epoch of a receiver, a compass, the IMU each 50 ms."""
    said = b""
    for number in range(epochs):
        gps = bytes([0x30 + number % 3, 5, 0x0A, (128 + number) % 255, 128, 0])
        compass = bytes([0x38, 25, number])
        imu = bytes([0x39, 20, 128, 127, 127])
        said += gps + compass + imu
    return said


def stuck() -> bytes:
    """A compass that repeats its reading while the course turns to starboard, and then moves again, without an IMU."""
    said = b""
    for number in range(120):
        turned = 0 if number < 50 else 62  # steps of 1.44 degrees
        gps = bytes([0x30, 100, 0x0D, 128, 128, turned])
        compass = bytes([0x38, 100, 1 if number < 10 else 0 if number < 100 else 60])
        said += gps + compass
    return said


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
    for method in range(4):
        seeds[f"core/method{method}"] = bytes([method, 0x73]) + cruise(40)
        seeds[f"core/stuck{method}"] = bytes([method, 0x13]) + stuck()
    epoch = GpsSample(0, 0, 1, 1.8e9, 36.0, 126.5, 0.0, 3.0, 90.0, 1.0, float("nan"), 8)
    seeds["core/raw"] = bytes([3, 0x73]) + b"\x2a\x64" + epoch.pack() + cruise(8)
    for name, seed in seeds.items():
        (CORPUS / name).parent.mkdir(parents=True, exist_ok=True)
        (CORPUS / name).write_bytes(seed)


if __name__ == "__main__":
    main()

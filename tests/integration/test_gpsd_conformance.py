"""107 real receivers' logs through the GPS decoder, against the fixes that gpsd made of the same bytes.

gpsd is an independent decoder. Its `.chk` files hold its reports (TPV) as JSON among the input. Every TPV with a fix
(mode 2 or 3) and a time must have a sample of the same UTC with the same position (1e-6 degrees) and, where the TPV has
them, speed (0.01 m/s) and track (0.01 degrees).

Two differences are of principle, and each TPV that claims one is held to its rule:

- gpsd reports after nearly every sentence. Before the epoch's RMC or VTG it has no speed of the receiver's, and
  computes one: the distance from an earlier fix over the time. Such a TPV has no track, and its speed has to be
  just that (`is_derived_speed`); its position is compared as any other's.
- Before gpsd knows a date, its TPV has no time. Of these the position alone is compared, with any epoch's.

`EXPLAINED` and `EXPLAINED_TIMELESS` list what is left.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from acquisition.gps import GpsDecoder
from acquisition.sample import GpsSample

#: Log -> how many TPVs differ, and why.
EXPLAINED: dict[str, tuple[int, str]] = {
    "bt451.log": (
        10,
        "two drives in one file: the clock goes back by 52 minutes, and the first two epochs after that are dropped "
        "as going backwards, before the third makes the new time believed; five TPVs each",
    ),
    "humminbird-M37.log": (
        3,
        "two passages in one file: the clock goes back by 12 s, and the first two epochs after that are dropped",
    ),
    "telit-he910.log": (
        8,
        "the receiver once sets its clock back by 0.3 s: that one epoch is dropped (five TPVs), and gpsd derives the "
        "first speed of the next epoch from it (three)",
    ),
    "ericsson-gru04-02-70sec.log": (
        2,
        "once a minute a GGA with another position (0.2 arc minutes away) follows the GNS of the same second; gpsd "
        "reports both, we had closed the epoch with the sentence that ended the last one, as it had until then",
    ),
}

#: The same for fixes without a time: log -> how many positions we do not have, and why.
EXPLAINED_TIMELESS: dict[str, tuple[int, str]] = {
    "GPSmap-76S.log": (2, "a simulator: GGA has quality 8, but RMC of the same epoch status V, which is no position"),
    "garmin-geko201.log": (
        2,
        "a simulator: GGA has quality 8, but RMC of the same epoch status V, which is no position",
    ),
    "mtk-3301.log": (1, "the last epoch before the first fix: quality 0 and status V, with numbers beside"),
    "tr737A+.log": (1, "the last epoch before the first fix: quality 0 and status V, with numbers beside"),
    "myguide-3100.log": (2, "before the first fix: GGA has a blank quality, RMC of the same epoch status V"),
}

#: gpsd takes the date of this receiver for one of the GPS week rollover's, and adds 1024 weeks. Ours is the log's own.
ROLLED_OVER = {"neo-m8n.log": 1024 * 7 * 86400.0}

SAME_TIME_S = 0.006  # some receivers round the time to 1/100 s in one sentence and not in another
EARTH_RADIUS_M = 6378137.0


def epochs_of(log: Path) -> tuple[list[GpsSample], Counter[str]]:
    """Every epoch of a log, the last one included: a void epoch behind it closes it."""
    decoder = GpsDecoder(0)
    samples: list[GpsSample] = []
    lines = decoder.framing().feed(log.read_bytes() + b"\n")
    for i, line in enumerate(lines):
        samples += decoder.decode(i * 10_000, line)
    samples += decoder.decode(len(lines) * 10_000, b"$GPRMC,,V,,,,,,,,,,N*53")
    return [sample for sample in samples if not math.isnan(sample.lat_deg)], decoder.counts


def fixes_of(check: Path) -> list[dict[str, Any]]:
    """gpsd's reports with a fix and its position (a GSA alone makes it report a mode without one)."""
    fixes = []
    for line in check.read_bytes().splitlines():
        if line.startswith(b'{"class":"TPV"'):
            report = json.loads(line)
            if report["mode"] >= 2 and "lat" in report:
                fixes.append(report)
    return fixes


def is_same_position(fix: dict[str, Any], sample: GpsSample) -> bool:
    return abs(sample.lat_deg - fix["lat"]) <= 1e-6 and abs(sample.lon_deg - fix["lon"]) <= 1e-6


def is_same_motion(fix: dict[str, Any], sample: GpsSample) -> bool:
    if "speed" in fix and not abs(sample.speed_mps - fix["speed"]) <= 0.01:
        return False
    return "track" not in fix or abs((sample.course_deg - fix["track"] + 180) % 360 - 180) <= 0.01


def is_derived_speed(fix: dict[str, Any], utc_s: float, epochs: list[GpsSample]) -> bool:
    """Whether the speed is the distance from one of the three fixes before, over the time since then."""
    if "track" in fix:
        return False
    before = sorted(
        (sample for sample in epochs if sample.utc_s < utc_s - SAME_TIME_S), key=lambda sample: sample.utc_s
    )
    for earlier in before[-3:]:
        north = math.radians(fix["lat"] - earlier.lat_deg)
        east = math.radians(fix["lon"] - earlier.lon_deg) * math.cos(math.radians(fix["lat"]))
        speed_mps = EARTH_RADIUS_M * math.hypot(north, east) / (utc_s - earlier.utc_s)
        if abs(speed_mps - fix["speed"]) <= 0.01 + 0.01 * speed_mps:
            return True
    return False


def compare(name: str, fixes: list[dict[str, Any]], epochs: list[GpsSample]) -> Counter[str]:
    """How many of a log's fixes are equal, equal but for a derived speed, timeless, or different."""
    result: Counter[str] = Counter()
    for fix in fixes:
        if "time" not in fix:
            result["timeless"] += 1
            if not any(is_same_position(fix, sample) for sample in epochs):
                result["timeless, position unknown"] += 1
            continue
        result["compared"] += 1
        utc_s = datetime.fromisoformat(fix["time"]).timestamp() - ROLLED_OVER.get(name, 0.0)
        here = [s for s in epochs if abs(s.utc_s - utc_s) < SAME_TIME_S and is_same_position(fix, s)]
        if any(is_same_motion(fix, sample) for sample in here):
            result["equal"] += 1
        elif here and is_derived_speed(fix, utc_s, epochs):
            result["derived speed"] += 1
        else:
            result["different"] += 1
    return result


@pytest.fixture(scope="module")
def logs(recordings: Path) -> list[Path]:
    return sorted((recordings / "gpsd-nmea").glob("*.log"))


def test_every_fix_of_gpsd_is_ours_or_explained(logs: list[Path]) -> None:
    total: Counter[str] = Counter()
    different: dict[str, int] = {}
    timeless: dict[str, int] = {}
    for log in logs:
        epochs, counts = epochs_of(log)
        assert counts["samples"] >= len(epochs)
        result = compare(log.name, fixes_of(log.with_name(log.name + ".chk")), epochs)
        total += result
        if result["different"]:
            different[log.name] = result["different"]
        if result["timeless, position unknown"]:
            timeless[log.name] = result["timeless, position unknown"]
    print(f"\n{len(logs)} logs: {dict(total)}; different: {different}; timeless: {timeless}")
    assert different == {name: count for name, (count, _) in EXPLAINED.items()}
    assert timeless == {name: count for name, (count, _) in EXPLAINED_TIMELESS.items()}
    # So that the test cannot pass on nothing.
    assert len(logs) == 107
    assert total["compared"] == 4940
    assert total["equal"] > 4200
    assert total["equal"] + total["derived speed"] + sum(different.values()) == total["compared"]
    assert total["timeless"] == 136


@pytest.mark.parametrize("folder", ["alinghi/alinghi.log", "comma2k19/comma.log"])
def test_a_real_recording_gives_an_epoch_for_nearly_every_gga(recordings: Path, folder: str) -> None:
    decoder = GpsDecoder(0)
    samples: list[GpsSample] = []
    ggas = 0
    for entry in (recordings / folder).read_bytes().splitlines():
        t_s, _, rest = entry.partition(b" ")
        source, _, line = rest.partition(b" ")
        if source == b"gps1":
            ggas += b"GGA" in line
            samples += decoder.decode(round(float(t_s) * 1e6), line)
    assert ggas > 500
    assert ggas * 0.97 < len(samples) < ggas * 1.04
    assert decoder.counts["malformed"] == decoder.counts["checksum"] == decoder.counts["foreign"] == 0
    assert all(not math.isnan(sample.lat_deg) and not math.isnan(sample.utc_s) for sample in samples)

"""The long reference stream: ten minutes of the project's simulated boat, decoded like a real recording."""

from __future__ import annotations

import functools
import hashlib

from acquisition.decoder import make_decoder
from acquisition.sample import Sample
from acquisition.simulator.grades import GRADES
from acquisition.simulator.scenarios import scenario_named
from acquisition.simulator.voyage import Voyage

DURATION_S = 600
VARIATION_DEG = -8.5
_DRIVERS = {"compass": "nmea", "imu": "ebimu-ascii"}


@functools.cache
def ten_minutes() -> tuple[Sample, ...]:
    """Samples of the scenario `tour`, typical devices, seed 1."""
    voyage = Voyage(scenario_named("tour"), GRADES["typical"], seed=1)
    decoders = {}
    samples: list[Sample] = []
    for _ in range(DURATION_S * 100):
        for t_us, source, line in voyage.advance():
            if source not in decoders:
                decoders[source] = make_decoder(source, _DRIVERS.get(source, "nmea"), {})
            samples.extend(decoders[source].decode(t_us, line))
    return tuple(samples)


def checksum() -> str:
    """Of the samples' records: says whether the simulator or the decoders have changed since the goldens were made."""
    digest = hashlib.sha256()
    for sample in ten_minutes():
        digest.update(sample.pack())
    return digest.hexdigest()

"""What can be evaluated: the fusion's methods, single sensors, and other people's filters."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from difflib import get_close_matches
from functools import partial

import numpy as np

from acquisition.recording import Event
from acquisition.sample import MAX_GPS
from tinyekf_py.config import METHODS, apply_flat
from tinyekf_py.estimate_array import estimates_to_array
from tinyekf_py.evaluate import peers, sensor_readers
from tinyekf_py.evaluate.decoded import Decoded
from tinyekf_py.evaluate.outcome import Outcome, no_weights
from tinyekf_py.fusion import fusion_of


class MethodError(ValueError):
    """A method that does not exist, or needs what is not installed."""


Method = Callable[[Decoded], Outcome]


def run_fusion(decoded: Decoded, method: str) -> Outcome:
    """One of the fusion's own methods."""
    config = apply_flat(decoded.config, {"fusion.method": method}, "--method")
    fusion = fusion_of(config)
    began = time.perf_counter()
    rows = []
    for part in decoded.parts:
        if isinstance(part, Event):
            rows += fusion.obey(part)
        else:
            rows += fusion.feed_records(part)
    seconds = time.perf_counter() - began
    table = estimates_to_array(rows, fusion.n_gps)
    weights = np.stack([table[f"w{n}"] for n in decoded.gps_numbers], axis=1) if decoded.gps_numbers else no_weights()
    return Outcome(
        method,
        table["t_s"],
        table["heading_deg"],
        table["heading_sigma_deg"],
        seconds,
        table["lat_deg"],
        table["lon_deg"],
        weights,
        fusion.mean_nis,
    )


def _registry() -> dict[str, Method]:
    return {
        **{name: partial(run_fusion, method=name) for name in METHODS},
        "compass": sensor_readers.compass,
        "course": sensor_readers.course,
        **{f"gps{n}-course": partial(sensor_readers.course_of, number=n) for n in range(1, MAX_GPS + 1)},
        "imufusion": peers.imufusion_compass,
        "imufusion-course": peers.imufusion_course,
        "filterpy": peers.filterpy_ekf,
    }


def method_names() -> tuple[str, ...]:
    """Every method there is."""
    return tuple(_registry())


def default_methods() -> tuple[str, ...]:
    """What is evaluated unless something else is asked for: the fusion's three-filter methods and the sensors."""
    fusion = tuple(name for name in METHODS if name != "cnw-ekf")
    return (*fusion, "gps1-course", "gps2-course", "gps3-course", "compass")


def all_methods() -> tuple[str, ...]:
    """What can run here on three receivers: the peers' packages may be missing."""
    return tuple(
        name
        for name in method_names()
        if not peers.missing_package(name) and name not in {f"gps{n}-course" for n in range(4, MAX_GPS + 1)}
    )


def check_methods(names: Iterable[str]) -> tuple[str, ...]:
    """`names` as they are; MethodError for one that does not exist or whose package is missing."""
    known = method_names()
    for name in names:
        if name not in known:
            near = get_close_matches(name, known, 1, cutoff=0.0)
            raise MethodError(f"no method {name!r}; did you mean {near[0]}? There is {', '.join(known)}")
        missing = peers.missing_package(name)
        if missing:
            raise MethodError(f"method {name} needs the package {missing}: install the extra [bench]")
    return tuple(names)


def run_method(decoded: Decoded, name: str) -> Outcome:
    """Run the method `name` on a recording."""
    return _registry()[name](decoded)

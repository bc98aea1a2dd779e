"""How far the C core is from the reference: the largest relative difference of every function and stream.

    python tests/reference/agreement.py

Measures, all relative: a number by max(1, |reference|) in its unit (metres, radians, degrees, weights); an angle by the
wrapped difference over max(1, |reference|), in degrees at the surface; an element (i, j) of a covariance by
sqrt(reference_ii reference_jj), which is free of units and does not excuse a small element beside a large one. NaN must
meet NaN and a mode its equal: otherwise the difference is infinite.
"""

from __future__ import annotations

import gzip
import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from boat import Loss, TaskSwitch
from cases import FUNCTIONS, MAX_HEADINGS, Table
from make_cases import RECORDING, sources_of
from numpy.typing import NDArray
from streams import STREAMS, Stream

GOLDEN = Path(__file__).resolve().parent / "golden"
MODES = ("invalid", "dead-reckoning", "degraded", "ok")
POSITION_MODES = ("invalid", "dead-reckoning", "gps")
RUNS = tuple((stream, method) for stream in (*STREAMS, RECORDING) for method in stream.methods)

Array = NDArray[np.float64]


def golden(name: str, folder: Path = GOLDEN) -> Table:
    """The golden outputs of a function, or of a stream's method as `golden_name` says."""
    with gzip.open(folder / f"{name}.csv.gz", "rt", encoding="ascii") as file:
        names = tuple(file.readline().strip().split(","))
        return Table(names, np.loadtxt(file, delimiter=",", ndmin=2))


def golden_name(stream: Stream, method: str) -> str:
    """Name of the golden file of a stream and method."""
    return f"{stream.name}_{method.replace('-', '_')}"


def relative(core: Array, reference: Array, scale: Array | float = 1.0) -> float:
    """Largest |core - reference| / max(scale, |reference|); infinite where one is NaN and the other is not."""
    core, reference = np.asarray(core, dtype=float), np.asarray(reference, dtype=float)
    if (np.isnan(core) != np.isnan(reference)).any():
        return math.inf
    difference = np.abs(core - reference) / np.maximum(scale, np.abs(reference))
    return float(np.nanmax(difference, initial=0.0))


def angular(core: Array, reference: Array, turn: float = 360.0) -> float:
    """As `relative` for angles: the difference is wrapped."""
    core, reference = np.asarray(core, dtype=float), np.asarray(reference, dtype=float)
    wrapped = reference + (core - reference) - turn * np.round((core - reference) / turn)
    return relative(wrapped, reference)


def covariance(core: Array, reference: Array) -> float:
    """Largest difference of two covariances of shape (n, n) in units of the standard deviations."""
    deviation = np.sqrt(np.diag(reference))
    return float(np.max(np.abs(core - reference) / np.outer(deviation, deviation)))


def state(core: Array, reference: Array, angles: tuple[int, ...]) -> float:
    """Largest relative difference of two states of shape (n,), of which `angles` are in radians."""
    straight = [row for row in range(len(reference)) if row not in angles]
    turning = list(angles)
    return max(relative(core[straight], reference[straight]), angular(core[turning], reference[turning], 2 * math.pi))


def _square(row: Array) -> Array:
    return row.reshape(3, 3).copy()


def _forward_azimuth(cases: Array, goldens: Array) -> Iterator[tuple[str, float]]:
    from tinyekf_py import forward_azimuth

    yield "forward_azimuth", angular(forward_azimuth(*cases.T), goldens[:, 0])


def _cnw_stage1(cases: Array, goldens: Array) -> Iterator[tuple[str, float]]:
    from tinyekf_py import cnw_stage1

    yield "cnw_stage1", relative(cnw_stage1(cases[:, 0].astype(int), cases[:, 1]), goldens[:, 0])


def _weighed(row: Array) -> tuple[Array, Array]:
    n = int(row[0])
    return row[2 : 2 + n], row[2 + MAX_HEADINGS : 2 + MAX_HEADINGS + n]


def _cnw_stage2(cases: Array, goldens: Array) -> Iterator[tuple[str, float]]:
    from tinyekf_py import cnw_stage2

    core = [cnw_stage2(*_weighed(row), float(row[1])) for row in cases]
    yield "cnw_stage2", angular(np.array(core), goldens[:, 0])


def _cnw_stage3(cases: Array, goldens: Array) -> Iterator[tuple[str, float]]:
    from tinyekf_py import cnw_stage3

    core = [cnw_stage3(*_weighed(row)) for row in cases]
    yield "cnw_stage3", angular(np.array(core), goldens[:, 0])


def _covariance_intersection(cases: Array, goldens: Array) -> Iterator[tuple[str, float]]:
    from tinyekf_py import covariance_intersection

    worst_c = worst_omega = worst_covariance = 0.0
    for row, reference in zip(cases, goldens, strict=True):
        angles = (2,) if row[1] else ()
        c, fused, omega = covariance_intersection(
            row[2:5].copy(),
            _square(row[5:14]),
            row[14:17].copy(),
            _square(row[17:26]),
            minimise="trace" if row[0] else "det",
            angles=angles,
        )
        worst_c = max(worst_c, state(np.asarray(c), reference[:3], angles))
        worst_covariance = max(worst_covariance, covariance(np.asarray(fused), _square(reference[3:12])))
        worst_omega = max(worst_omega, relative(omega, reference[12]))
    yield "covariance_intersection c", worst_c
    yield "covariance_intersection C", worst_covariance
    yield "covariance_intersection omega", worst_omega


def _ekf(cases: Array, goldens: Array) -> Iterator[tuple[str, float]]:
    from tinyekf_py import Ekf

    worst = {"predict": 0.0, "update": 0.0, "step": 0.0}
    for row, reference in zip(cases, goldens, strict=True):
        angles = (2,) if row[0] else ()
        p, f, q, h, r = (_square(row[k : k + 9]) for k in (1, 13, 22, 34, 43))
        fx, z, hx = (row[k : k + 3].copy() for k in (10, 31, 52))
        filter_, stepped = Ekf(fx, p), Ekf(fx, p)
        filter_.predict(fx, f, q)
        predicted = (np.array(filter_.x), np.array(filter_.P))
        filter_.update(z, h, r, hx=hx, angles=angles)
        stepped.step(z, fx, f, q, h, r)
        results = (predicted, (filter_.x, filter_.P), (stepped.x, stepped.P))
        for k, (name, (x, cov)) in enumerate(zip(worst, results, strict=True)):
            x_reference, p_reference = reference[12 * k : 12 * k + 3], _square(reference[12 * k + 3 : 12 * k + 12])
            worst[name] = max(
                worst[name],
                state(np.asarray(x), x_reference, angles if name != "step" else ()),
                covariance(np.asarray(cov), p_reference),
            )
    yield from ((f"Ekf.{name}", value) for name, value in worst.items())


def _heading_ekf(cases: Array, goldens: Array) -> Iterator[tuple[str, float]]:
    from tinyekf_py import HeadingEkf

    deg2 = math.radians(1.0) ** 2
    filter_ = HeadingEkf(
        np.array([0.0, 0.0, 3.0]),
        np.diag([10.0, 10.0, 100 * deg2]),
        np.diag([0.01, 0.01, 10 * deg2]),
        np.diag([0.3, 0.07, 0.03 * deg2]),
    )
    worst = 0.0
    for row, reference in zip(cases, goldens, strict=True):
        u, v, r, dt = (float(value) for value in row[:4])
        filter_.predict(u, v, r, dt)
        filter_.update(row[7:10].copy(), mask=row[4:7] != 0)
        worst = max(worst, state(np.asarray(filter_.x), reference[:3], (2,)))
        worst = max(worst, covariance(np.asarray(filter_.P), _square(reference[3:])))
    yield "HeadingEkf", worst


_COMPARISONS: dict[str, Callable[[Array, Array], Iterator[tuple[str, float]]]] = {
    "forward_azimuth": _forward_azimuth,
    "cnw_stage1": _cnw_stage1,
    "cnw_stage2": _cnw_stage2,
    "cnw_stage3": _cnw_stage3,
    "covariance_intersection": _covariance_intersection,
    "ekf": _ekf,
    "heading_ekf": _heading_ekf,
}


def function_differences(name: str) -> dict[str, float]:
    """Largest relative differences of a function of `cases.FUNCTIONS`, by what is compared."""
    return dict(_COMPARISONS[name](FUNCTIONS[name]().rows, golden(name).rows))


def core_rows(stream: Stream, method: str) -> list[tuple[float, ...]]:
    """The C core's rows over a stream, as columns of the golden file, the modes as their numbers there."""
    from tinyekf_py.fusion import HeadingFusion

    options = stream.options
    fusion = HeadingFusion(
        method,
        sources=sources_of(options),
        variation_deg="auto" if math.isnan(options.variation_deg) else options.variation_deg,
        deviation_deg=options.deviation,
        mount_deg=options.mount_deg,
        accel="specific-force" if options.specific_force else "gravity",
        max_sigma_deg=options.max_sigma_deg,
    )
    estimates = []
    waiting = bytearray()
    for item in stream.items():
        if isinstance(item, TaskSwitch):
            estimates += fusion.feed_records(bytes(waiting))
            waiting.clear()
            estimates += fusion.set_task(item.t_us, item.name, item.running)
        elif isinstance(item, Loss):
            estimates += fusion.feed_records(bytes(waiting))
            waiting.clear()
            estimates += fusion.lose(item.t_us, item.name)
        else:
            waiting += item.pack()
    estimates += fusion.feed_records(bytes(waiting))
    return [
        (
            e.t_us / 1e6,
            *e[1:6],
            MODES.index(e.mode),
            POSITION_MODES.index(e.pos_mode),
            *e.weights[: options.n_gps],
            *e.faz_deg[: options.n_gps],
            e.gpsec_deg,
            *e.ekf_deg[: options.n_gps],
        )
        for e in estimates
    ]


def _configured_columns(table: Table, n_gps: int) -> tuple[tuple[str, ...], Array]:
    """Golden columns without those of receivers that are not configured."""
    spare = {f"{kind}{number}{unit}" for number in range(n_gps + 1, 9) for kind, unit in _PER_GPS}
    kept = [column for column, name in enumerate(table.names) if name not in spare]
    return tuple(table.names[column] for column in kept), table.rows[:, kept]


_PER_GPS = (("w", ""), ("faz", "_deg"), ("ekf", "_deg"))


def stream_differences(stream: Stream, method: str) -> dict[str, float]:
    """Largest relative difference of each column of a stream's rows; infinite where rows or modes differ."""
    names, reference = _configured_columns(golden(golden_name(stream, method)), stream.options.n_gps)
    core = np.array(core_rows(stream, method))
    if stream.name == RECORDING.name:
        core = core[np.round(core[:, 0] * 10) % 10 == 0]
    if core.shape != reference.shape:
        return {"rows": math.inf}
    differences = {}
    for column, name in enumerate(names):
        if name in ("mode", "pos_mode"):
            differences[name] = 0.0 if (core[:, column] == reference[:, column]).all() else math.inf
        elif name.endswith("_deg") and name != "heading_sigma_deg":
            differences[name] = angular(core[:, column], reference[:, column])
        else:
            differences[name] = relative(core[:, column], reference[:, column])
    return differences


def main() -> None:
    """Print the table."""
    for name in FUNCTIONS:
        for what, difference in function_differences(name).items():
            print(f"{what:44} {difference:.1e}")
    for stream, method in RUNS:
        worst = max(stream_differences(stream, method).items(), key=lambda item: item[1])
        print(f"HeadingFusion {method:8} {stream.name:21} {worst[1]:.1e}  {worst[0]}")


if __name__ == "__main__":
    main()

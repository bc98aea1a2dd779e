"""The heading CSV: its columns, its decimals, and that reading gives back what was written."""

from __future__ import annotations

from itertools import repeat
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tinyekf_py.estimate import MODES, POSITION_MODES, Estimate
from tinyekf_py.estimate_array import estimates_to_array
from tinyekf_py.heading_csv import (
    HeadingCsvError,
    HeadingCsvWriter,
    format_header,
    format_row,
    read_heading_csv,
    write_heading_csv,
)

NAN = float("nan")
FULL = Estimate(
    12_300_000, 359.99999, 0.51234, -1.25, 35.960026, -126.5199936, "ok", "gps",
    (3.0, 2.0, 0.0), (0.0, 12.5, NAN), 1.0, (360.0, 0.00004, 180.0),
)  # fmt: skip

angles = st.one_of(st.just(NAN), st.floats(0, 360, exclude_max=True))
three = st.tuples(angles, angles, angles)
estimates = st.builds(
    Estimate,
    st.integers(0, 10**7).map(lambda tenths: tenths * 100_000),
    angles,
    st.one_of(st.just(NAN), st.floats(0, 180)),
    st.one_of(st.just(NAN), st.floats(-90, 90)),
    st.one_of(st.just(NAN), st.floats(-90, 90)),
    st.one_of(st.just(NAN), st.floats(-180, 180)),
    st.sampled_from(MODES),
    st.sampled_from(POSITION_MODES),
    st.tuples(*repeat(st.sampled_from([0.0, 1.0, 2.0, 3.0]), 3)),
    three,
    angles,
    three,
)


def test_columns_are_the_documented_ones() -> None:
    assert format_header(3) == (
        "t_s,heading_deg,heading_sigma_deg,rate_of_turn_dps,lat_deg,lon_deg,mode,pos_mode,w1,w2,w3,"
        "faz1_deg,faz2_deg,faz3_deg,gpsec_deg,ekf1_deg,ekf2_deg,ekf3_deg"
    )


def test_a_full_row() -> None:
    assert format_row(FULL, 3) == (
        "12.3,0.0000,0.5123,-1.2500,35.960026000,-126.519993600,ok,gps,3,2,0,0.0000,12.5000,,1.0000,0.0000,0.0000,180.0000"
    )


def test_an_empty_row_has_every_column() -> None:
    assert format_row(Estimate(0), 3) == "0.0,,,,,,invalid,invalid,,,,,,,,,,"
    assert format_row(Estimate(0), 5).count(",") == format_header(5).count(",") == 23


def test_fewer_receivers_leave_their_columns_empty() -> None:
    row = format_row(FULL._replace(weights=(2.5,), faz_deg=(1.0,), ekf_deg=(2.0,)), 1)
    assert row.endswith(",ok,gps,2.5,,,1.0000,,,1.0000,2.0000,,")


def test_nothing_prints_as_minus_zero_or_infinite() -> None:
    row = format_row(FULL._replace(rate_of_turn_dps=-1e-9, lat_deg=-1e-12, heading_sigma_deg=float("inf")), 3)
    assert row.startswith("12.3,0.0000,,0.0000,0.000000000,")


@given(estimate=estimates)
def test_what_is_written_is_read_back_to_its_decimals(
    tmp_path_factory: pytest.TempPathFactory, estimate: Estimate
) -> None:
    path = tmp_path_factory.mktemp("csv") / "h.csv"
    assert write_heading_csv(path, [estimate], 3) == 1
    read, expected = read_heading_csv(path)[0], estimates_to_array([estimate], 3)[0]
    for name in read.dtype.names:
        if name.endswith("mode"):
            assert read[name] == expected[name]
        elif name in ("lat_deg", "lon_deg", "t_s"):
            assert read[name] == pytest.approx(expected[name], abs=1e-9, nan_ok=True)
        else:  # the last decimal of an angle may have wrapped to zero
            difference = (read[name] - expected[name] + 180) % 360 - 180
            assert difference == pytest.approx(0 if np.isfinite(expected[name]) else NAN, abs=6e-5, nan_ok=True)


def test_live_writer_and_replay_write_the_same_bytes(tmp_path: Path) -> None:
    rows = [FULL._replace(t_us=i * 100_000, heading_deg=i % 360 + 0.123456) for i in range(3000)]
    writer = HeadingCsvWriter(tmp_path / "live.csv", 3)
    for row in rows:
        writer.row(row)
    writer.close()
    write_heading_csv(tmp_path / "replay.csv", rows, 3)
    assert (tmp_path / "live.csv").read_bytes() == (tmp_path / "replay.csv").read_bytes()
    assert len(read_heading_csv(tmp_path / "live.csv")) == 3000


def test_a_row_cut_by_a_power_cut_is_dropped(tmp_path: Path) -> None:
    path = tmp_path / "h.csv"
    path.write_text(f"{format_header(3)}\n{format_row(FULL, 3)}\n{format_row(FULL, 3)[:30]}")
    assert len(read_heading_csv(path)) == 1


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "is not a heading CSV"),
        (b"t_s,heading_deg\n0.0,1\n", "is not a heading CSV"),
        (b"\xff\xfe\n", "not text"),
        (f"{format_header(3)}\n0.0,1\n".encode(), "line 2: 2 fields"),
        (f"{format_header(3)}\n{format_row(FULL, 3).replace('12.3', 'x')}\n".encode(), "line 2: could not convert"),
        (f"{format_header(3)}\n{format_row(FULL, 3).replace('ok', 'fine')}\n".encode(), "line 2: no such mode"),
    ],
)
def test_damage_is_named(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "h.csv"
    path.write_bytes(content)
    with pytest.raises(HeadingCsvError) as refusal:
        read_heading_csv(path)
    assert says in str(refusal.value)
    assert str(path) in str(refusal.value)


def test_a_file_that_cannot_be_opened_is_named(tmp_path: Path) -> None:
    missing = tmp_path / "missing" / "h.csv"
    with pytest.raises(HeadingCsvError, match="No such file"):
        read_heading_csv(missing)
    with pytest.raises(HeadingCsvError, match="No such file"):
        write_heading_csv(missing, [], 3)
    with pytest.raises(HeadingCsvError, match="No such file"):
        HeadingCsvWriter(missing, 3)

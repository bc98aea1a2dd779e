"""Magnetic variation against the test values that NOAA and BGS publish with each World Magnetic Model."""

from __future__ import annotations

import logging
import math
import sys
from datetime import UTC, date, datetime, timedelta, timezone

import pytest

from tinyekf_py import variation
from tinyekf_py.variation import VariationError, variation_deg

pytest.importorskip("pygeomag", reason="needs the extra [geomag]")


@pytest.mark.parametrize(
    ("year", "lat_deg", "lon_deg", "declination_deg"),
    [
        (2010, 80, 0, -6.13), (2010, 0, 120, 0.97), (2010, -80, 240, 70.21),
        (2020, 80, 0, -1.28), (2020, 0, 120, 0.16), (2020, -80, 240, 69.36),
        (2025, 80, 0, 1.28), (2025, 0, 120, -0.16), (2025, -80, 240, 68.78),
    ],
)  # fmt: skip
def test_published_test_values(year: int, lat_deg: float, lon_deg: float, declination_deg: float) -> None:
    assert variation_deg(lat_deg, lon_deg, date(year, 1, 1)) == pytest.approx(declination_deg, abs=0.005)


@pytest.mark.parametrize("year", [2015, 2020, 2025])
def test_models_join_where_one_follows_the_other(year: int) -> None:
    before = variation_deg(36.0, 126.5, date(year - 1, 12, 31))
    assert variation_deg(36.0, 126.5, date(year, 1, 1)) == pytest.approx(before, abs=0.2)


def test_west_is_negative() -> None:
    assert variation_deg(35.96, 126.52, date(2026, 11, 24)) == pytest.approx(-8.5, abs=0.7)  # Gunsan


@pytest.mark.parametrize("day", [date(1999, 8, 22), date(2034, 6, 1)])
def test_outside_all_models_the_nearest_serves_with_a_warning(day: date, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        nearest = variation_deg(51.0, 0.0, day)
    assert variation_deg(51.0, 0.0, date(2010 if day.year < 2010 else 2029, 12, 31)) == pytest.approx(nearest, abs=2)
    assert "World Magnetic Model" in caplog.text


def test_it_goes_by_the_day_in_utc() -> None:
    eastern = timezone(timedelta(hours=9))
    new_year_in_korea = datetime(2020, 1, 1, 0, 0, tzinfo=eastern)
    assert variation_deg(80, 0, new_year_in_korea) == variation_deg(80, 0, datetime(2019, 12, 31, 15, tzinfo=UTC))


def test_it_is_unknown_at_the_magnetic_pole() -> None:
    assert math.isnan(variation_deg(86.0, 142.0, date(2026, 1, 1)))


@pytest.mark.parametrize(("lat_deg", "lon_deg"), [(91, 0), (math.nan, 0), (0, math.inf)])
def test_a_place_that_does_not_exist_is_refused(lat_deg: float, lon_deg: float) -> None:
    with pytest.raises(VariationError, match="no place"):
        variation_deg(lat_deg, lon_deg, date(2026, 1, 1))


def test_without_the_package_the_notice_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygeomag", None)
    variation._model.cache_clear()
    with pytest.raises(VariationError, match=r"\[geomag\]"):
        variation_deg(36.0, 126.5, date(2026, 1, 1))

"""Magnetic variation by the World Magnetic Model: the angle from magnetic to true north, east positive.

Fusion asks for it where `vessel.variation_deg` is "auto", at the position and the date that the GPS gives. The model
is reissued every five years; pygeomag (the extra `[geomag]`) carries the issues of 2010 to 2025, and a recording of
2016 is judged by the model of that time. Near the magnetic poles, where the model's own authors call a compass
unusable, the variation is unknown: NaN.
"""

from __future__ import annotations

import importlib
import logging
from datetime import UTC, date, datetime
from functools import cache
from typing import Any

#: First year of each model -> the module of pygeomag with its coefficients. Each is valid for five years.
MODELS = {2010: "WMM_2010", 2015: "WMM_2015v2", 2020: "WMM_2020", 2025: "WMM_2025"}
SPAN_YEARS = 5.0
#: How far a model is carried beyond its span: its linear drift says little after that.
MAX_EXTRAPOLATION_YEARS = 5.0

_log = logging.getLogger(__name__)


class VariationError(ValueError):
    """No variation can be computed: one line saying why, and what to do."""


def variation_deg(lat_deg: float, lon_deg: float, when: date) -> float:
    """Magnetic variation at sea level, degrees, east positive, at WGS-84 `lat_deg`, `lon_deg` on the day `when` (UTC).

    By the model whose span holds the day; outside 2010 to 2030 by the nearest, with a warning in the log, once a
    year. NaN where the horizontal field is too weak for a compass. VariationError without pygeomag, and for a
    position that does not exist.
    """
    if not (-90 <= lat_deg <= 90 and -360 <= lon_deg <= 360):
        raise VariationError(f"no place on earth: latitude {lat_deg}, longitude {lon_deg}")
    year = _decimal_year(when)
    first_year = max((first for first in MODELS if first <= year), default=min(MODELS))
    if not first_year <= year <= first_year + SPAN_YEARS:
        _warn_of_span(first_year, int(year))
        earliest, latest = first_year - MAX_EXTRAPOLATION_YEARS, first_year + SPAN_YEARS + MAX_EXTRAPOLATION_YEARS
        year = min(max(year, earliest), latest)
    field = _model(first_year).calculate(
        glat=lat_deg, glon=lon_deg, alt=0.0, time=year, allow_date_outside_lifespan=True
    )
    return float("nan") if field.in_blackout_zone else float(field.d)


def _decimal_year(when: date) -> float:
    if isinstance(when, datetime) and when.tzinfo is not None:
        when = when.astimezone(UTC)
    new_year = date(when.year, 1, 1).toordinal()
    days = date(when.year, 12, 31).toordinal() + 1 - new_year
    return when.year + (when.toordinal() - new_year) / days


@cache
def _model(first_year: int) -> Any:
    try:
        pygeomag = importlib.import_module("pygeomag")
        coefficients = importlib.import_module(f"pygeomag.wmm.{MODELS[first_year].lower()}")
    except ImportError as error:
        raise VariationError(
            "the magnetic variation is not computed: pygeomag is not installed; install the extra [geomag], "
            "or give vessel.variation_deg as a number"
        ) from error
    return pygeomag.GeoMag(coefficients_data=getattr(coefficients, MODELS[first_year]))


@cache
def _warn_of_span(first_year: int, year: int) -> None:
    _log.warning("no World Magnetic Model holds the year %d; the variation is that of WMM %d", year, first_year)

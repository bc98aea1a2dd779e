"""Trustworthy heading from three cheap GPS receivers, an electronic compass and a hobby IMU.

The names below are the library; the programs are `tinyekf run`, `tinyekf simulate` and so on. A name is loaded when it
is first used: the processes beside the fusion need neither NumPy nor the C core, and have no memory to spare for them.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tinyekf_py.core import (
        Ekf,
        HeadingEkf,
        Status,
        Update,
        cnw_stage1,
        cnw_stage2,
        cnw_stage3,
        covariance_intersection,
        forward_azimuth,
    )
    from tinyekf_py.estimate import Estimate
    from tinyekf_py.fusion import HeadingFusion

__all__ = [
    "Ekf",
    "Estimate",
    "HeadingEkf",
    "HeadingFusion",
    "Status",
    "Update",
    "cnw_stage1",
    "cnw_stage2",
    "cnw_stage3",
    "covariance_intersection",
    "forward_azimuth",
]

_ELSEWHERE = {"Estimate": "tinyekf_py.estimate", "HeadingFusion": "tinyekf_py.fusion"}


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_ELSEWHERE.get(name, "tinyekf_py.core")), name)

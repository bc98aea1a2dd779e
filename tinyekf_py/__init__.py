"""Trustworthy heading from three cheap GPS receivers, an electronic compass and a hobby IMU.

The names below are the library; the programs are `tinyekf run`, `tinyekf simulate` and so on.
"""

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

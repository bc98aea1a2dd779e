"""Samples as rows of a NumPy structured array, laid out as the records of `acquisition.sample`."""

from __future__ import annotations

import numpy as np

from acquisition.sample import SAMPLE_SIZE

#: A sample record as a NumPy row: fields of all three kinds lie over each other, `source` says which are meant.
sample_dtype = np.dtype(
    {
        "names": [
            *("t_us", "source", "code"),
            *("utc_s", "lat_deg", "lon_deg", "altitude_m", "speed_mps", "course_deg", "hdop", "gps_variation_deg"),
            *("satellites", "heading_deg", "deviation_deg", "variation_deg", "pitch_deg", "roll_deg"),
            *("attitude_deg", "gyro_dps", "accel_g", "mag_ut"),
        ],
        "formats": ["i8", "i4", "i4", *["f8"] * 8, "i4", *["f8"] * 5, *["3f8"] * 4],
        "offsets": [0, 8, 12, *range(16, 80, 8), 80, *range(16, 56, 8), 16, 40, 64, 88],
        "itemsize": SAMPLE_SIZE,
    }
)

"""Positioning a land vehicle by Kalman filter and least-squares adjustment: the third paper, on the same C core.

Files become channels (`channels`), channels epochs at the GPS time stamps (`drive`), epochs a track (`epoch`, in C).
"""

from tinyekf_py.vehicle.config import VehicleConfig, load_config
from tinyekf_py.vehicle.drive import Drive, hide_gps, read_drive
from tinyekf_py.vehicle.epoch import METHODS, covariances, empty_epochs, estimate_track
from tinyekf_py.vehicle.noise import PAPER, Noise
from tinyekf_py.vehicle.simulate import Grade, simulate_drive, write_drive
from tinyekf_py.vehicle.table import DriveError
from tinyekf_py.vehicle.track import read_truth, write_track

__all__ = [
    "METHODS",
    "PAPER",
    "Drive",
    "DriveError",
    "Grade",
    "Noise",
    "VehicleConfig",
    "covariances",
    "empty_epochs",
    "estimate_track",
    "hide_gps",
    "load_config",
    "read_drive",
    "read_truth",
    "simulate_drive",
    "write_drive",
    "write_track",
]

"""A pytest plugin for an emulated processor: no property fails for being slow, and each is tried on few examples."""

from __future__ import annotations

from hypothesis import HealthCheck, settings

settings.register_profile(
    "slow board",
    deadline=None,
    max_examples=5,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
settings.load_profile("slow board")

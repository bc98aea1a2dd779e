"""Two of the reference streams: sensors that stick at one value, which a gyro tells, or the courses."""

from __future__ import annotations

from boat import NAN, Boat, Item, Loss, between, sail, without

from acquisition.sample import COMPASS, IMU, CompassSample, GpsSample, Sample


def sticking() -> list[Item]:
    """Compass and IMU stick at one value, in a turn and bursts; a receiver and the compass are lost for a while."""
    last: dict[int, Sample] = {}
    items: list[Item] = []
    samples = sail(Boat(125, duration_s=36.0, rate_dps=lambda t_s: 6.0 if t_s < 26.0 else 0.0))
    for s in without(samples, lambda s: (s.source == 1 and between(27, 30, s)) or between(33, 34.2, s)):
        held = s.source == COMPASS and (between(6, 12, s) or between(27, 36, s))
        held = held or (s.source == IMU and (between(14, 18, s) or between(19, 19.9, s)))
        same = last[s.source]._replace(t_us=s.t_us) if held else s
        last[s.source] = same
        burst = s.source == IMU and between(5, 9, s)
        items.append(same._replace(t_us=s.t_us // 30_000 * 30_000 + 20_000) if burst else same)
    losses = [Loss(27_050_000, "gps2"), Loss(31_234_567, "compass"), Loss(33_000_000, "imu"), Loss(34_000_000, "gps1")]
    return sorted([*items, *losses], key=lambda item: item.t_us)


def sticking_unseen() -> list[Item]:
    """The compass sticks and no gyro tells: the courses deny it, one of them by its track; one receiver lies still."""

    def bent(s: Sample) -> Sample:
        if isinstance(s, CompassSample) and (between(4, 44, s) or between(52, 88, s)):
            return s._replace(heading_deg=1.0 if s.t_us < 50_000_000 else 123.4)
        if isinstance(s, GpsSample) and s.source == 1:
            return s._replace(speed_mps=NAN) if s.t_us < 60_000_000 else s._replace(course_deg=NAN, hdop=NAN)
        if isinstance(s, GpsSample) and s.source == 2 and between(12, 70, s):
            return s._replace(lat_deg=35.96, lon_deg=126.52, speed_mps=0.2, course_deg=NAN)
        if isinstance(s, GpsSample) and between(84, 88, s):
            return s._replace(speed_mps=500.0)
        return s

    def rate(t_s: float) -> float:
        return 5.0 if 20.0 < t_s < 38.0 or 60.0 < t_s < 80.0 else 0.0

    samples = sail(Boat(127, duration_s=92.0, rate_dps=rate))
    samples = without(samples, lambda s: s.source == IMU and between(8, 90, s))
    samples = without(samples, lambda s: s.source == COMPASS and between(14, 16, s))
    return [bent(s) for s in without(samples, lambda s: s.source == 0 and between(25, 31, s))]

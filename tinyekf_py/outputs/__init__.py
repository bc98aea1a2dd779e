"""What the program gives to others: NMEA 0183, Signal K, a live page, metrics.

    live program ──frames──> output process ──> clients
                 <──requests (start, stop)──

All of it runs in one process of its own, which can never delay the fusion: a frame that it does not take is lost, and
if it dies it is started again. Nothing here needs NumPy or the C core.
"""

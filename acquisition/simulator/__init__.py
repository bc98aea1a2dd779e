"""The simulated boat: one vessel, five devices with the errors of real ones, and the truth.

`vessel` moves the boat, `gps`, `compass` and `imu` print what devices aboard would print, `voyage` brings their lines
into the order of their arrival. `recorder` writes them as a recording, `ptys` serves them like real devices. What is
sailed is a value of `scenarios`; how good the devices are, a value of `grades`. Everything follows from one seed.
"""

"""The car's wire and the last party before it: codec, calibration, limits, arming, gateway."""

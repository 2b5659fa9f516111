"""A value that changes steadily: what it is, how fast it changes, and how sure that is.

It must not know what the value is of: a place across the path, a speed.
"""

from __future__ import annotations


class Trend:
    """A Kalman filter on a value and its rate, which wanders with a spectral density (Bar-Shalom, 2001, 6.2)."""

    __slots__ = ("covariance", "density", "rate", "rate_variance", "value", "variance")

    def __init__(self, value: float, variance: float, rate_variance: float, density: float) -> None:
        """Begin at a value; the rate is taken for 0, as surely as `rate_variance` says; `density` [rate^2/s]."""
        self.value, self.rate, self.density = value, 0.0, density
        self.variance, self.covariance, self.rate_variance = variance, 0.0, rate_variance

    def predict(self, dt: float) -> None:
        """Move on by a time [s] at the present rate."""
        density = self.density
        self.value += self.rate * dt
        self.variance += dt * (2.0 * self.covariance + dt * (self.rate_variance + density * dt / 3.0))
        self.covariance += dt * (self.rate_variance + 0.5 * density * dt)
        self.rate_variance += density * dt

    def update(self, value: float, variance: float) -> None:
        """Take a measurement of the value in."""
        total, error = self.variance + variance, value - self.value
        gain, rate_gain = self.variance / total, self.covariance / total
        self.value += gain * error
        self.rate += rate_gain * error
        self.rate_variance -= rate_gain * self.covariance
        self.covariance -= gain * self.covariance
        self.variance -= gain * self.variance

    def ahead(self, dt: float) -> tuple[float, float]:
        """Return the value to be expected after a time [s], and its variance, if the rate stays as it is."""
        return (
            self.value + self.rate * dt,
            self.variance + dt * (2.0 * self.covariance + dt * (self.rate_variance + self.density * dt / 3.0)),
        )

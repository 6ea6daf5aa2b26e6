"""Section 2 of the paper: a circle off the C axis by X and C together, equations (2) to (8)."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Circle:
    """The path: centre at `x_t` mm from the C axis, `radius` mm, `feed` mm/min along it, `direction` +1 (ccw) or -1.

    φ is the polar angle about the circle's centre, θ that about the C axis, both in rad; C is commanded to θ.
    """

    x_t: float
    radius: float = 50.0
    feed: float = 1000.0
    direction: int = 1

    @property
    def u(self) -> float:
        """X_T/r."""
        return self.x_t / self.radius

    @property
    def phi_rate(self) -> float:
        """dφ/dt = F/(60 r), rad/s, signed."""
        return self.direction * self.feed / (60.0 * self.radius)

    def theta(self, phi: ArrayLike) -> Array:
        """θ of (3), unwrapped, rad: over one turn it grows by 2π for X_T < r, by π for X_T = r, by nothing for X_T > r."""
        phi = np.asarray(phi, dtype=float)
        if self.x_t == self.radius:
            return phi / 2.0
        angle = np.arctan2(self.radius * np.sin(phi), self.x_t + self.radius * np.cos(phi))
        return np.asarray(angle + 2.0 * np.pi * np.round(phi / (2.0 * np.pi)) if self.u < 1.0 else angle)

    def x(self, phi: ArrayLike) -> Array:
        """X of (4), mm; at X_T = r the branch that stays smooth and passes through zero."""
        phi = np.asarray(phi, dtype=float)
        if self.x_t == self.radius:
            return np.asarray(2.0 * self.radius * np.cos(phi / 2.0))
        return np.asarray(np.hypot(self.x_t + self.radius * np.cos(phi), self.radius * np.sin(phi)))

    def theta_rate(self, phi: ArrayLike) -> Array:
        """ω of (6), rad/s."""
        cosine = np.cos(phi)
        if self.x_t == self.radius:
            return np.full_like(cosine, self.phi_rate / 2.0)
        return (1.0 + self.u * cosine) / (1.0 + 2.0 * self.u * cosine + self.u**2) * self.phi_rate

    def theta_acceleration(self, phi: ArrayLike) -> Array:
        """d²θ/dt² of (7), rad/s²."""
        cosine, u = np.cos(phi), self.u
        if self.x_t == self.radius:
            return np.zeros_like(cosine)
        return u * np.sin(phi) * (1.0 - u**2) / (1.0 + 2.0 * u * cosine + u**2) ** 2 * self.phi_rate**2

    def x_rate(self, phi: ArrayLike) -> Array:
        """dX/dt = -X_T r sin φ/X · dφ/dt, mm/s."""
        phi = np.asarray(phi, dtype=float)
        if self.x_t == self.radius:
            return np.asarray(-self.radius * np.sin(phi / 2.0) * self.phi_rate)
        return np.asarray(-self.x_t * self.radius * np.sin(phi) / self.x(phi) * self.phi_rate)

    @property
    def fastest_c(self) -> float:
        """ω_max of (8), rad/s: F/(60 |X_T - r|), and half of dφ/dt at X_T = r."""
        gap = abs(self.x_t - self.radius)
        return abs(self.phi_rate) / 2.0 if gap == 0.0 else self.feed / (60.0 * gap)

    @property
    def reversals(self) -> Array:
        """φ in rad where C turns back, cos φ = -1/u: two for X_T > r, none for X_T ≤ r."""
        if self.u <= 1.0:
            return np.empty(0)
        first = np.arccos(-1.0 / self.u)
        return np.array([first, 2.0 * np.pi - first])


def derived_rates(circle: Circle, phi: ArrayLike) -> tuple[Array, Array, Array]:
    """(dθ/dt, d²θ/dt², dX/dt) in rad/s, rad/s², mm/s at φ (N,), by automatic differentiation of (3) and (4).

    These know nothing of (5) to (8): they are what those equations are held against. Not for X_T = r at φ = π.
    """
    angle = ca.SX.sym("phi")
    x, y = circle.x_t + circle.radius * ca.cos(angle), circle.radius * ca.sin(angle)
    theta, reach = ca.atan2(y, x), ca.sqrt(x**2 + y**2)
    first = ca.jacobian(theta, angle) * circle.phi_rate
    second = ca.jacobian(first, angle) * circle.phi_rate
    rates = ca.Function("rates", [angle], [first, second, ca.jacobian(reach, angle) * circle.phi_rate])
    values = rates(np.atleast_2d(np.asarray(phi, dtype=float)))
    theta_rate, theta_acceleration, x_rate = (np.asarray(value, dtype=float).ravel() for value in values)
    return theta_rate, theta_acceleration, x_rate

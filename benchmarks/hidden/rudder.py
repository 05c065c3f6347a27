"""A blade in the wake of a propeller, as a wing of small aspect ratio in a stream.

The stream at the blade is (u + w, v + x r), where the propeller's jet w follows from momentum:
half the thrust's dynamic pressure, (u + w)² = u² + 2 F / ρ A for a boat that runs ahead. The wing's
force stands square on the blade, is ∝ sin of the angle of attack and no larger than at 30°.
Slope of the lift: 6.13 Λ / (2.25 + Λ). Source: Molland and Turnock, Marine Rudders and Control
Surfaces, 2007 (Fujii's slope; momentum of the slipstream).
"""

import math

from benchmarks.hidden.outputs import Rudder
from benchmarks.hidden.scene import Push, Scene

RHO, STALLED = 1000.0, 0.5  # kg/m³, sine of the angle of attack


def blade(rudder: Rudder, angle: float, thrust: float, s: Scene) -> Push:
    """Angle [rad] and thrust of the propeller ahead of it [N] -> force of the blade."""
    wake = 2.0 * max(thrust, 0.0) / (RHO * math.pi / 4.0 * rudder.area * rudder.aspect)
    along = s.u + math.sqrt(s.u**2 + wake) - abs(s.u)
    across = s.v + rudder.x * s.r
    speed = math.hypot(along, across)
    # the sine of the sum of angle and drift, by components: no angle is ever formed
    sine = (math.sin(angle) * along + math.cos(angle) * across) / speed if speed > 0.0 else 0.0
    slope = 6.13 * rudder.aspect / (2.25 + rudder.aspect)
    force = 0.5 * RHO * rudder.area * slope * min(max(sine, -STALLED), STALLED) * speed**2
    Y = -force * math.cos(angle)
    return Push(-force * math.sin(angle), Y, rudder.x * Y)

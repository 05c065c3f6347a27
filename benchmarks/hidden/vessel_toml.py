"""The vessel file of a boat, written without the gateway's help: what its owner would know."""

from benchmarks.hidden.boats import NINE, Boat
from benchmarks.hidden.outputs import Motor, Rudder


def vessel_toml(boat: Boat) -> str:
    """A boat with nothing hidden -> the text of its vessel file."""
    hull = boat.hull
    lines = [
        f'name = "{boat.name}"',
        f'source = "{boat.source}"',
        "",
        "[hull]",
        f"length = {hull.length}   # m",
        f"beam = {hull.beam}   # m",
        f"mass = {hull.mass}   # kg",
        f"wind_area = [{hull.frontal}, {hull.lateral}]   # m², frontal and lateral",
        "",
        "[dynamics]   # kg, kg, kg m²; derivatives negative = damping",
        *(f"{name} = {getattr(hull, name)!r}" for name in NINE),
    ]
    for motor in boat.motors:
        lines += ["", *_thruster(motor, boat.curve)]
    for rudder in boat.rudders:
        lines += ["", *_rudder(rudder)]
    return "\n".join(lines) + "\n"


def _thruster(motor: Motor, curve: int) -> list[str]:
    return [
        "[[thrusters]]",
        f'name = "{motor.name}"',
        f"channel = {motor.channel}",
        f"position = [{motor.x}, {motor.y}]   # m, forward and starboard",
        f"pwm = {list(motor.pulses)}   # µs: lowest, neutral, highest",
        f"reversed = {str(motor.reversed).lower()}",
        f"thrust = [{motor.astern}, {motor.ahead}]   # N, full astern and full ahead",
        f'curve = "{"linear" if curve == 1 else "quadratic"}"',
    ]


def _rudder(rudder: Rudder) -> list[str]:
    blade = [
        f"area = {rudder.area}   # m²",
        f"aspect = {rudder.aspect}",
        f'wash = "{rudder.behind}"',
    ]
    return [
        "[[rudders]]",
        f'name = "{rudder.name}"',
        f"channel = {rudder.channel}",
        f"position = [{rudder.x}, 0.0]   # m, forward and starboard",
        f"pwm = {list(rudder.pulses)}   # µs: lowest, neutral, highest",
        f"reversed = {str(rudder.reversed).lower()}",
        f"angle = [{-rudder.most}, {rudder.most}]   # rad",
        *(blade if rudder.area else [f'motor = "{rudder.behind}"']),
    ]

"""The vessel file of a boat, written without the gateway's help: what its owner would know."""

from benchmarks.hidden.boats import NINE, Boat, Motor


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

"""Source text of a kernel: the laws of one vessel composed into one Python module.

The text is unrolled over thrusters, rudders and effects, and calls each law by name. Its only
branches pass over an effect whose numbers are neutral (a model that holds thirty effects switched
off costs little more than the bare vessel) and laws that these numbers leave without work (a table
over the speed has nothing to say of each motor). They are decided once, where the numbers are
unpacked, and in plain Python never taken: there the numbers may be arrays, that are not all one.
`sim.kernel` lists the composed functions. Effects act in the order of the
catalogue, whatever their order in the vessel file. The loops of `LOOPS` are appended as they stand
in their files, with the imports that those files have.
"""

import ast
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import lru_cache
from itertools import groupby, pairwise
from typing import NamedTuple

from sim.body import Body, RudderParameters, ThrusterParameters
from sim.effects.effect import Effect
from sim.kernel.compiled import source_text

LOOPS = (
    "sim.kernel.loops",
    "sim.following.loops",
    "sim.following.monitor_loops",
    "sim.hil.loops",
)
MARK = "# -- the text from here on goes into the kernel --\n"

HEADER = '''"""Kernel written by sim.kernel.generator for: {title}. Do not edit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sim.actuators import (
    angle_of, axis_of, pointing, ramp, rudder_force, slipstream, thrust_at, thrust_of,
    thruster_force,
)
from sim.balance import (
    acceleration_through, balance_residual, base_inertia, kinematics, relative_velocity, solve,
    velocity_through,
)
from sim.body import Body, Flow, HeldInputs, Report, RudderParameters, ThrusterParameters
from sim.sensing import at_antenna
from sim.state import Pose, Velocity, Water, Wrench, add_water, add_wrench
{imports}

NX = {nx}
'''
SURROUNDINGS = [
    "water = water_at(time, Pose(x[0], x[1], x[2]), p)",
    "flow = flow_at(x, time, inputs, water, p)",
]
ACTUATORS = "tau, commanded = actuator_wrench(x, flow, inputs, p)"


class Structure(NamedTuple):
    """What decides the text of a kernel: how many of what, and which effects."""

    thrusters: int
    rudders: tuple[tuple[int, int], ...]  # per rudder: thruster it turns or −1, wash or −1
    effects: tuple[Effect, ...]
    tables: tuple[int, ...] = ()  # per thruster: the owner of its table of thrust, or −1
    knots: tuple[tuple[float, ...], ...] = ()  # per thruster: commands of its own table

    @property
    def memories(self) -> list[tuple[int, str, int]]:
        """(effect, law, actuator) of each state beyond pose and velocity, in order."""
        out = []
        for e, effect in enumerate(self.effects):
            if effect.thrust_rate:
                out += [(e, "thrust_rate", i) for i in range(self.thrusters)]
            if effect.angle_rate:
                out += [(e, "angle_rate", i) for i in range(len(self.rudders))]
            if effect.rate:
                out += [(e, "rate", 0)]
        return out

    @property
    def nx(self) -> int:
        """Length of a state."""
        return 6 + len(self.memories)

    @property
    def actuators(self) -> int:
        """Columns of a command table (at least one)."""
        return max(self.thrusters + len(self.rudders), 1)

    @property
    def table_owners(self) -> list[int]:
        """Thrusters that have a table of their own."""
        return [i for i, table in enumerate(self.tables) if table == i]

    @property
    def tuples(self) -> list[tuple[str, str, int]]:
        """(field, type, count of parameters) of each part of `Numbers`, in the order of theta."""
        thruster, rudder = len(ThrusterParameters._fields) - 1, len(RudderParameters._fields) - 1
        return [
            ("body", "Body", len(Body._fields)),
            *((f"t{i}", "ThrusterParameters", thruster) for i in range(self.thrusters)),
            *((f"r{i}", "RudderParameters", rudder) for i in range(len(self.rudders))),
            *((f"k{i}", f"K{i}", len(self.knots[i])) for i in self.table_owners),
            *((f"e{e}", f"P{e}", len(effect.parameters)) for e, effect in enumerate(self.effects)),
        ]

    def acting(self, place: str) -> Iterator[int]:
        """Numbers of the effects that act there."""
        return (i for i, effect in enumerate(self.effects) if getattr(effect, place) is not None)

    def switches(self) -> dict[str, str]:
        """Switch -> its test: `off_E`, the numbers of effect E are neutral; `rests_LAW_E`, they
        leave one of its laws nothing to do; `idle_PLACE`, all that act there and can be switched
        off are; `linear_I`, a thrust without bend.
        """
        out = {}
        for e, effect in enumerate(self.effects):
            neutral = {p.name: p.neutral for p in effect.parameters}
            off = [f"(e{e}.{n} == {x!r})" for n, x in neutral.items() if x is not None]
            if off:
                out[f"off_{e}"] = " & ".join(off)
            for law, numbers in effect.acts_when.items():
                unlike = (
                    "(" + " & ".join(f"(e{e}.{name} != {x!r})" for x in values) + ")"
                    for name, values in numbers.items()
                )
                out[f"rests_{law}_{e}"] = " | ".join(unlike)
        for place in ("water", "thrust", "force"):
            each = [f"off_{e}" for e in self.acting(place) if f"off_{e}" in out]
            out[f"idle_{place}"] = " & ".join(each) or "True"
        return out | {f"linear_{i}": f"t{i}.exponent == 1.0" for i in range(self.thrusters)}

    def can_be_off(self, effect: int) -> bool:
        """Whether an effect has numbers with which it does nothing."""
        return any(p.neutral is not None for p in self.effects[effect].parameters)

    def applied(self, effect: int, place: str, name: str, to: str) -> str:
        """The line that gives `name` its value after a law of an effect, unless that is passed
        over.
        """
        asked = [f"off_{effect}"] if self.can_be_off(effect) else []
        asked += [f"rests_{place}_{effect}"] if place in self.effects[effect].acts_when else []
        tests = " or ".join(f"p.skip.{switch}" for switch in asked)
        return f"{name} = {name} if {tests} else {to}" if tests else f"{name} = {to}"

    def after_all(self, place: str, name: str, law: Callable[[int], str]) -> list[str]:
        """Lines that give `name` its value after each effect that acts there: `law` of its number.

        Of neighbours that can be switched off none is asked where all are.
        """
        out = []
        for switched, some in groupby(self.acting(place), self.can_be_off):
            own = [self.applied(e, place, name, law(e)) for e in some]
            together = switched and len(own) > 1
            out += [f"if not p.skip.idle_{place}:", *(f"    {x}" for x in own)] if together else own
        return out

    def memory(self, effect: int, place: str, actuator: int) -> int:
        """Position in the state of that memory."""
        return 6 + self.memories.index((effect, place, actuator))


def _tuple(items: Sequence[str]) -> str:
    return "(" + ", ".join(items) + ("," if len(items) == 1 else "") + ")"


def _function(head: str, lines: Sequence[str]) -> str:
    return "\n\n@jit\ndef " + head + ":\n" + "\n".join("    " + line for line in lines) + "\n"


def _class(name: str, members: Iterable[tuple[str, str]]) -> str:
    return f"\n\nclass {name}(NamedTuple):\n" + "".join(f"    {m}: {kind}\n" for m, kind in members)


def _unpack(s: Structure, plain: bool) -> str:
    """`unpack`: the vector of parameters into named tuples, and what these numbers switch off."""
    text, at, lines = "", 0, []
    for i in s.table_owners:
        text += _class(f"K{i}", [(f"at_{k}", "float") for k in range(len(s.knots[i]))])
    for e, effect in enumerate(s.effects):
        text += f"\n# P{e}: {', '.join(numbers_of(effect))} of {effect.name}"
    text += _class("Switches", [(name, "bool") for name in s.switches()])
    for field, kind, count in s.tuples:
        made = f"numbers_at(theta, {at}, {kind})" if count else f"{kind}(0.0)"
        if kind in ("ThrusterParameters", "RudderParameters"):  # which know their own place
            values = [f"{field[1:]}.0", *(f"theta[{k}]" for k in range(at, at + count))]
            made = f"{kind}({', '.join(values)})"
        lines.append(f"{field} = {made}")
        at += count
    text += _class(
        "Numbers", [*((field, kind) for field, kind, _ in s.tuples), ("skip", "Switches")]
    )
    lines += [f"{name} = {False if plain else test}" for name, test in s.switches().items()]
    lines.append(f"skip = Switches({', '.join(s.switches())})")
    lines.append(f"return Numbers({', '.join(field for field, _, _ in s.tuples)}, skip)")
    return text + _function("unpack(theta)", lines)


def numbers_of(effect: Effect) -> tuple[str, ...]:
    """Names of an effect's parameters, in the order of its laws' tuple."""
    return tuple(p.name for p in effect.parameters) or ("none",)


def _state(s: Structure) -> str:
    """Arithmetic on states, the delay of all commands and the age of reports."""
    n = s.nx
    delays = [f"delay_{e}(p.e{e})" for e in s.acting("delay")]
    ages = [f"latency_{e}(p.e{e})" for e in s.acting("latency")]
    return (
        _function("axpy(x, h, k)", ["return " + _tuple([f"x[{i}] + h * k[{i}]" for i in range(n)])])
        + _function("state_from(row)", ["return " + _tuple([f"row[{i}]" for i in range(n)])])
        + _function("delay_of(p)", ["return " + " + ".join(["0.0", *delays])])
        + _function("latency_of(p)", ["return " + " + ".join(["0.0", *ages])])
    )


def _surroundings(s: Structure) -> str:
    """`water_at` and `flow_at`: how the boat moves through water and world."""
    lines = ["water = Water(0.0, 0.0, 0.0, 0.0)"]
    law = "add_water(water, water_{0}(time, pose, p.e{0}))"
    lines += s.after_all("water", "water", law.format)
    return _function("water_at(time, pose, p)", [*lines, "return water"]) + _function(
        "flow_at(x, time, inputs, water, p)",
        [
            "nu = velocity_through(water, Pose(x[0], x[1], x[2]), Velocity(x[3], x[4], x[5]))",
            "return Flow(nu.u, nu.v, nu.r, x[3], x[4], x[0], x[1], x[2], time, inputs.voltage,",
            "            inputs.wind_north, inputs.wind_east, inputs.wind_known, p.body)",
        ],
    )


def _share(command: str, numbers: str, knots: Sequence[float]) -> str:
    """Sum of ramps between the knots of a table, from (−1, −1) through (0, 0) to (1, 1)."""
    ends = {-1.0: "-1.0", 0.0: "0.0", 1.0: "1.0"}
    values = ends | {c: f"{numbers}.at_{k}" for k, c in enumerate(knots)}
    steps = [
        f"({values[b]} - {values[a]}) * ramp({command}, {a!r}, {b!r})"
        for a, b in pairwise(sorted(values))
    ]
    return " + ".join(["-1.0", *steps])


def _static_actuation(s: Structure) -> str:
    """`static_actuation`: thrusts and angles of the commands, as far as motion does not matter."""
    count = s.thrusters + len(s.rudders)
    lines, names = ["c = " + _tuple([f"row[{i}]" for i in range(max(count, 1))])], []
    for e in s.acting("wiring"):
        wired = [f"wiring_{e}(c, {i}.0, p.e{e})" for i in range(count)]
        lines.append("c = " + _tuple(wired or ["row[0]"]))
    for i in range(s.thrusters):
        names.append(f"F{i}")
        lines.append(f"c{i} = c[{i}]")
        lines += [
            s.applied(e, "command", f"c{i}", f"command_{e}(c{i}, p.t{i}, p.e{e})")
            for e in s.acting("command")
        ]
        table, bent = s.tables[i] if s.tables else -1, f"thrust_of(c{i}, p.t{i})"
        lines.append(
            f"F{i} = thrust_at(c{i}, c{i}, p.t{i}) if p.skip.linear_{i} else {bent}"
            if table < 0
            else f"F{i} = thrust_at(c{i}, {_share(f'c{i}', f'p.k{table}', s.knots[table])}, p.t{i})"
        )
    for i in range(len(s.rudders)):
        names.append(f"d{i}")
        lines.append(f"d{i} = angle_of(c[{s.thrusters + i}], p.r{i})")
        lines += [
            s.applied(e, "angle", f"d{i}", f"angle_{e}(d{i}, p.r{i}, p.e{e})")
            for e in s.acting("angle")
        ]
    return _function("static_actuation(row, p)", [*lines, "return " + _tuple(names or ["row[0]"])])


def _actuator_wrench(s: Structure) -> str:
    """`actuator_wrench`: the wrench, and the commanded thrusts and angles that memory follows."""
    lines, commanded, turned = ["tau = Wrench(0.0, 0.0, 0.0)"], {}, {}
    for i, (motor, _) in enumerate(s.rudders):
        lines.append(f"d{i} = inputs.actuation[{s.thrusters + i}]")
        for e in s.acting("angle_rate"):
            at = s.memory(e, "angle_rate", i)
            commanded[at] = f"d{i}_{e}"
            lines += [f"d{i}_{e} = d{i}", f"d{i} = x[{at}]"]
        if motor >= 0:
            turned[motor] = f" - d{i}"
    for i in range(s.thrusters):
        lines.append(f"F{i} = inputs.actuation[{i}]")
        law = f"thrust_{{0}}(F{i}, p.t{i}, flow, p.e{{0}})"
        lines += s.after_all("thrust", f"F{i}", law.format)
        for e in s.acting("thrust_rate"):
            at = s.memory(e, "thrust_rate", i)
            commanded[at] = f"F{i}_{e}"
            lines += [f"F{i}_{e} = F{i}", f"F{i} = x[{at}]"]
        lines.append(f"a{i} = p.t{i}.azimuth{turned.get(i, '')}")
        lines.append(f"axis{i} = axis_of(a{i})")  # the same all along a run that nothing turns
        for e in s.acting("turn"):
            lines.append(s.applied(e, "turn", f"a{i}", f"turn_{e}(a{i}, p.t{i}, flow, p.e{e})"))
            lines.append(s.applied(e, "turn", f"axis{i}", f"axis_of(a{i})"))
        lines.append(f"tau = add_wrench(tau, thruster_force(F{i}, axis{i}, p.t{i}))")
        for e in s.acting("reaction"):
            own = f"add_wrench(tau, reaction_{e}(F{i}, pointing(p.t{i}, a{i}), flow, p.e{e}))"
            lines.append(s.applied(e, "reaction", "tau", own))
    for i, (motor, wash) in enumerate(s.rudders):
        if motor < 0:
            jet = f"slipstream(flow.u, F{wash}, p.r{i})" if wash >= 0 else "0.0"
            lines.append(f"tau = add_wrench(tau, rudder_force(d{i}, flow, {jet}, p.r{i}))")
    inputs = [commanded.get(6 + k, "0.0") for k in range(len(s.memories))]
    return _function(
        "actuator_wrench(x, flow, inputs, p)", [*lines, "return tau, " + _tuple([*inputs, "0.0"])]
    )


def _memory(s: Structure) -> str:
    """`settle_memory` and `memory_rates`: where memory starts and how it changes."""
    settled, change = [], []
    for k, (e, place, i) in enumerate(s.memories):
        if place == "rate":
            settled.append(f"{s.effects[e].start!r} + 0.0 * x[0]")
            change.append(f"rate_{e}(flow, x[{6 + k}], p.e{e})")
        else:
            actuator = f"p.{'t' if place == 'thrust_rate' else 'r'}{i}"
            settled.append(f"commanded[{k}]")
            change.append(f"{place}_{e}(commanded[{k}], x[{6 + k}], {actuator}, p.e{e})")
    motion = [f"x[{i}]" for i in range(6)]
    lines = [*SURROUNDINGS]
    for k in range(len(settled)):  # one memory may feed the next
        memory = [f"x[{6 + j}]" if j != k else settled[j] for j in range(len(settled))]
        lines += [ACTUATORS, "x = " + _tuple(motion + memory)]
    return _function("settle_memory(x, time, inputs, p)", [*lines, "return x"]) + _function(
        "memory_rates(x, flow, commanded, p)", ["return " + _tuple([*change, "0.0"])]
    )


def _dynamics(s: Structure) -> str:
    """The balance with all effects, and what is computed from it: rates and wrenches."""
    balance = [
        "pose, nu = Pose(x[0], x[1], x[2]), Velocity(x[3], x[4], x[5])",
        "M = base_inertia(p.body)",
        *(
            s.applied(e, "inertia", "M", f"inertia_{e}(M, flow, p.e{e})")
            for e in s.acting("inertia")
        ),
    ]

    def force(e: int) -> str:
        own = f", x[{s.memory(e, 'rate', 0)}]" if s.effects[e].rate else ""
        return f"add_wrench(tau, force_{e}(flow{own}, p.e{e}))"

    balance += s.after_all("force", "tau", force)
    balance += [
        "rel_dot = acceleration_through(water, pose, nu, Velocity(u_dot, v_dot, r_dot))",
        "return M, balance_residual(M, p.body, relative_velocity(flow), rel_dot, tau)",
    ]
    solved = [
        "M, rest = balance(x, 0.0, 0.0, 0.0, water, flow, tau, p)",
        "nu_dot = solve(M, Wrench(-rest.X, -rest.Y, -rest.N))",
        "pose_dot = kinematics(Pose(x[0], x[1], x[2]), Velocity(x[3], x[4], x[5]))",
    ]
    six = ["pose_dot[0]", "pose_dot[1]", "pose_dot[2]", "nu_dot.u", "nu_dot.v", "nu_dot.r"]
    rates = [f"memory_dot[{k}]" for k in range(len(s.memories))]
    fluid = [  # actuators keep their memory under a force; an effect's own state does not
        f"rate_{e}(flow, x[{6 + k}], p.e{e})" if place == "rate" else f"0.0 * x[{6 + k}]"
        for k, (e, place, _) in enumerate(s.memories)
    ]
    residual = ["M, rest = balance(x, u_dot, v_dot, r_dot, water, flow, tau, p)", "return rest"]
    arguments = "(x, u_dot, v_dot, r_dot, time, inputs, p)"
    memory_dot = "memory_dot = memory_rates(x, flow, commanded, p)"
    no_actuators = "tau = Wrench(0.0, 0.0, 0.0)"
    functions = {
        "balance(x, u_dot, v_dot, r_dot, water, flow, tau, p)": balance,
        "state_rates(x, time, inputs, p)": [
            *SURROUNDINGS, ACTUATORS, memory_dot, *solved, "return " + _tuple(six + rates)
        ],
        "state_rates_with_force(x, time, inputs, extra, p)": [
            *SURROUNDINGS, ACTUATORS, memory_dot, "tau = add_wrench(tau, extra)", *solved,
            "return " + _tuple(six + rates),
        ],
        "state_rates_under_force(x, time, inputs, tau, p)": [
            *SURROUNDINGS, *solved, "return " + _tuple(six + fluid)
        ],
        "commanded_wrench(x, time, inputs, p)": [*SURROUNDINGS, ACTUATORS, "return tau"],
        "missing_wrench" + arguments: [*SURROUNDINGS, ACTUATORS, *residual],
        "required_wrench" + arguments: [*SURROUNDINGS, no_actuators, *residual],
    }  # fmt: skip
    return "".join(_function(head, lines) for head, lines in functions.items())


def _observe(s: Structure) -> str:
    """`observe`: lever arm of the antenna, then sensor effects; `observe_undelayed`: none late."""

    def chain(effects: Iterable[int]) -> list[str]:
        laws = [s.applied(e, "observe", "report", f"observe_{e}(report, p.e{e})") for e in effects]
        return ["report = at_antenna(report, p.body)", *laws, "return report"]

    undelayed = (e for e in s.acting("observe") if s.effects[e].latency is None)
    return _function("observe(report, p)", chain(s.acting("observe"))) + _function(
        "observe_undelayed(report, p)", chain(undelayed)
    )


def kernel_text(s: Structure, plain: bool = False) -> str:
    """The whole module for a structure, as Python source; `plain`: for arrays too."""
    title = f"{s.thrusters} thrusters, {len(s.rudders)} rudders, " + (
        ", ".join(effect.name for effect in s.effects) or "no effects"
    )
    imports = "\n".join(line for name in LOOPS for line in _loop(name).imports)
    parts = [HEADER.format(title=title, nx=s.nx, imports=imports), _unpack(s, plain)]
    parts += [_state(s), _surroundings(s), _static_actuation(s), _actuator_wrench(s), _memory(s)]
    parts += [_dynamics(s), _observe(s)]
    return "".join([*parts, *(_loop(name).text for name in LOOPS)])


class _Loop(NamedTuple):
    """The part of a loop file that goes into a kernel, and the imports that it needs there."""

    imports: tuple[str, ...]
    text: str


@lru_cache
def _loop(module: str) -> _Loop:
    """A loop file; the kernel itself has what other loop files and `sim.jit` give there."""
    before, text = source_text(module).split(MARK)
    imports = [
        ast.unparse(node)
        for node in ast.parse(before).body
        if isinstance(node, ast.ImportFrom)
        and str(node.module).startswith("sim.")
        and node.module not in ("sim.jit", *LOOPS)
    ]
    return _Loop(tuple(imports), "\n" + text)

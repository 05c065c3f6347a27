"""A stand-in for ArduPilot's side of Lua: just the calls of its documentation that a plan makes.

Time passes when `step` is called. What a test changes (`ap.armed = False`) the script sees next.
"""

from dataclasses import dataclass, field

from lupa.lua53 import LuaRuntime

GUIDED, HOLD, MANUAL = 15, 4, 0
CALLS = """
local ap = ...
local function object(methods) return setmetatable({}, {__index = methods}) end
local millis_type = {}
millis_type.__index = {tofloat = function(self) return self.value + 0.0 end}
millis_type.__sub = function(a, b)
  return setmetatable({value = (a.value - b.value) % 4294967296}, millis_type)
end
function millis() return setmetatable({value = ap.millis()}, millis_type) end
gcs = object{send_text = function(_, severity, text) ap.say(severity, text) end}
arming = object{is_armed = function() return ap.get("armed") end}
vehicle = object{
  get_mode = function() return ap.get("mode") end,
  set_mode = function(_, mode) return ap.set_mode(mode) end,
  set_steering_and_throttle = function(_, steer, throttle) return ap.drive(steer, throttle) end,
}
local switch = object{get_aux_switch_pos = function() return ap.get("switch") end}
rc = object{
  find_channel_for_option = function(_, option)
    if option == 300 and ap.get("has_switch") then return switch end
  end,
  has_valid_input = function() return ap.get("remote") end,
  get_pwm = function(_, channel) return ap.stick(channel) end,
}
param = object{get = function(_, name) return ap.param(name) end}
battery = object{
  num_instances = function() return 1 end,
  healthy = function() return ap.get("battery_healthy") end,
  voltage = function(_, k) return ap.get("volts") end,
}
local function place(x)
  return object{x = x, get_distance = function(self, other) return math.abs(x - other.x) end}
end
ahrs = object{
  healthy = function() return ap.get("ekf") end,
  get_location = function() if ap.get("fix") then return place(ap.get("north_m")) end end,
  groundspeed_vector = function()
    return object{length = function() return ap.get("speed_mps") end}
  end,
}
SRV_Channels = object{get_output_pwm_chan = function(_, chan) return ap.pulse(chan) end}
"""


@dataclass
class Autopilot:
    """The boat around the script, ready to start: armed, in Guided, switch low."""

    text: str
    armed: bool = True
    mode: int = GUIDED
    switch: int = 0
    has_switch: bool = True
    remote: bool = True
    ekf: bool = True
    fix: bool = True
    battery_healthy: bool = True
    volts: float = 15.0
    north_m: float = 100.0
    speed_mps: float = 0.5
    takes_sticks: bool = True
    clock_ms: int = 4294967296 - 3000  # it wraps while the script runs
    sticks: dict = field(default_factory=lambda: {1: 1500, 3: 1500})
    params: dict = field(
        default_factory=lambda: {"RCMAP_ROLL": 1.0, "RCMAP_THROTTLE": 3.0, "BATT_LOW_VOLT": 12.0}
    )
    pulses: dict = field(default_factory=dict)
    driven: list = field(default_factory=list)  # (ms, steer, throttle)
    said: list = field(default_factory=list)
    modes: list = field(default_factory=list)

    def __post_init__(self):
        self.lua = LuaRuntime(unpack_returned_tuples=True, register_eval=False)
        self.lua.execute(CALLS, self.lua.table_from({
            "millis": lambda: self.clock_ms % 4294967296,
            "say": lambda severity, text: self.said.append(text),
            "get": lambda name: getattr(self, name),
            "set_mode": self._set_mode,
            "drive": self._drive,
            "stick": lambda channel: self.sticks.get(channel),
            "param": lambda name: self.params.get(name),
            "pulse": lambda chan: self.pulses.get(chan + 1),
        }))  # fmt: skip
        self.update, self.wait_ms = self.lua.execute(self.text)

    def _set_mode(self, mode):
        self.mode = mode
        self.modes.append(mode)
        return True

    def _drive(self, steer, throttle):
        if self.mode != GUIDED or not self.takes_sticks:
            return False
        self.driven.append((self.clock_ms, steer, throttle))
        return True

    def step(self, late_ms=0):
        """The scheduler calls the script once more."""
        self.clock_ms += int(self.wait_ms) + late_ms
        self.update, self.wait_ms = self.update()

    def run(self, seconds):
        end = self.clock_ms + 1000 * seconds
        while self.clock_ms < end:
            self.step()
        return self

    def started(self, seconds=8.0):
        """Switch low, then high, and some way into the plan."""
        self.run(2.0)
        self.switch = 2
        return self.run(seconds)

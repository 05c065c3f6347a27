-- Excitation "$name" for $vessel: $seconds s, predicted to stay within $reach m of its start.
-- Written by shadow plan, shadow-gateway $version. ArduPilot Rover (boats too), 4.4 or newer.
--
-- Copy to APM/scripts, SCR_ENABLE = 1, RCn_OPTION = 300 (Scripting1) for a switch of your remote.
-- To run it: arm, go to Guided, sticks still, switch from low to high. It ends by itself.
-- It stops at once, in Hold, when: the switch leaves high, a stick moves, the remote is lost, the
-- boat is disarmed, the mode changes, the boat is too far out, too fast, without a position, its
-- battery low, its outputs beyond the pulses of the plan, or the script itself too late or wrong.
-- Before the first run: propellers clear, a second person, the autopilot's own failsafes set.

local RADIUS_M = $radius
local HIGHEST_SPEED_MPS = $speed
local TIME_OUT_MS = $time_out * 1000
-- 0: the autopilot's BATT_LOW_VOLT
local LOWEST_VOLTAGE_V = $voltage
-- throttle, steer: 1 is full travel; largest change per second
local LARGEST = {$throttle, $steer}
local RATE = {$throttle_rate, $steer_rate}
-- {channel, lowest, highest}: what the plan itself asks for and a little more, in us
local PULSES = {$pulses}
local STICK_US = 80                       -- a stick that moved this much is the pilot's hand
local STEP_MS = 50
local LATE_MS = 500                       -- a script that was held up this long stops
local LOW_MS, PULSE_MS = 2000, 500        -- how long a low battery, a wrong pulse may last
local SETTLE_MS = 1500                    -- before pulses are watched: Guided was loitering
local GUIDED, HOLD = 15, 4                -- modes of Rover
local SCRIPTING1 = 300
local ERROR, WARNING, INFO = 3, 4, 6
-- milliseconds, throttle and steer in thousandths, straight lines in between
local PLAN = {
$rows
}

local state = "waiting"   -- waiting, running, stopping
local ready = false       -- the switch was seen low: only then may it start something
local began, stepped, origin, sticks, lowest_v, corner, now
local low_ms, pulse_ms = 0, 0

local function say(severity, text)
  gcs:send_text(severity, "Plan: " .. text)
end

local function switch_high()
  local switch = rc:find_channel_for_option(SCRIPTING1)
  return switch ~= nil and switch:get_aux_switch_pos() == 2
end

local function stick_pulses()
  local steer = rc:get_pwm(math.floor(param:get("RCMAP_ROLL") or 1))
  local throttle = rc:get_pwm(math.floor(param:get("RCMAP_THROTTLE") or 3))
  if not steer or not throttle then return nil end
  return {steer, throttle}
end

local function voltage()
  if battery:num_instances() < 1 or not battery:healthy(0) then return nil end
  return battery:voltage(0)
end

-- Why it may not start: a text, or nil.
local function refusal()
  if not arming:is_armed() then return "not armed" end
  if vehicle:get_mode() ~= GUIDED then return "mode is not Guided" end
  if not rc:has_valid_input() or not stick_pulses() then return "no remote control" end
  if not ahrs:healthy() or not ahrs:get_location() then return "no position" end
  local limit = LOWEST_VOLTAGE_V
  if limit <= 0 then limit = param:get("BATT_LOW_VOLT") or 0 end
  if limit > 0 then
    local volts = voltage()
    if not volts then return "no battery voltage" end
    if volts < limit then return "battery low" end
  end
  return nil
end

-- Why it must stop: a text, or nil.
local function danger(elapsed_ms, step_ms)
  if not arming:is_armed() then return "disarmed" end
  if vehicle:get_mode() ~= GUIDED then return "mode changed" end
  if not rc:has_valid_input() then return "remote lost" end
  if not switch_high() then return "switch" end
  local hand = stick_pulses()
  if not hand then return "remote lost" end
  for k = 1, 2 do
    if math.abs(hand[k] - sticks[k]) > STICK_US then return "stick moved" end
  end
  if step_ms > LATE_MS then return "script held up" end
  if elapsed_ms > TIME_OUT_MS then return "time is out" end
  local here = ahrs:get_location()
  if not here or not ahrs:healthy() then return "position lost" end
  if here:get_distance(origin) > RADIUS_M then return "out of the circle" end
  if ahrs:groundspeed_vector():length() > HIGHEST_SPEED_MPS then return "too fast" end
  if lowest_v > 0 then
    local volts = voltage()
    low_ms = (volts and volts >= lowest_v) and 0 or low_ms + step_ms
    if low_ms > LOW_MS then return "battery low" end
  end
  local wrong = nil
  for _, bound in ipairs(PULSES) do
    local pulse = SRV_Channels:get_output_pwm_chan(bound[1] - 1)
    if pulse and (pulse < bound[2] or pulse > bound[3]) then wrong = bound[1] end
  end
  pulse_ms = (wrong and elapsed_ms > SETTLE_MS) and pulse_ms + step_ms or 0
  if pulse_ms > PULSE_MS then return "output " .. wrong .. " beyond the plan" end
  return nil
end

-- Throttle and steer of the plan at a moment; nil when it is over.
local function wanted(elapsed_ms)
  while corner + 5 <= #PLAN and PLAN[corner + 3] <= elapsed_ms do corner = corner + 3 end
  if corner + 5 > #PLAN then return nil end
  local share = (elapsed_ms - PLAN[corner]) / (PLAN[corner + 3] - PLAN[corner])
  local both = {}
  for k = 1, 2 do
    both[k] = (PLAN[corner + k] + share * (PLAN[corner + 3 + k] - PLAN[corner + k])) / 1000
  end
  return both
end

-- The same, no further and no faster than the limits, whatever the table says.
local function limited(both, step_ms)
  for k = 1, 2 do
    local aim = math.max(math.min(both[k], LARGEST[k]), -LARGEST[k])
    local most = RATE[k] * step_ms / 1000
    now[k] = now[k] + math.max(math.min(aim - now[k], most), -most)
  end
end

local function stop(severity, text)
  say(severity, text)
  state = "stopping"
end

-- Neutral, then Hold: left in Guided, a boat would go back to where it loitered.
local function stopping()
  if not arming:is_armed() or vehicle:get_mode() ~= GUIDED then
    state = "waiting"
    return
  end
  vehicle:set_steering_and_throttle(0, 0)
  vehicle:set_mode(HOLD)
end

local function start()
  local why = refusal()
  ready = false
  if why then return say(WARNING, "will not start, " .. why) end
  lowest_v = LOWEST_VOLTAGE_V
  if lowest_v <= 0 then lowest_v = param:get("BATT_LOW_VOLT") or 0 end
  began, origin, sticks = millis(), ahrs:get_location(), stick_pulses()
  stepped, corner, now, low_ms, pulse_ms = began, 1, {0, 0}, 0, 0
  if lowest_v <= 0 then say(WARNING, "no limit of battery voltage") end
  say(INFO, "starts, $seconds s")
  state = "running"
end

local function running()
  local time = millis()
  local elapsed_ms, step_ms = (time - began):tofloat(), (time - stepped):tofloat()
  stepped = time
  local why = danger(elapsed_ms, step_ms)
  if why then return stop(ERROR, "stopped, " .. why) end
  local both = wanted(elapsed_ms)
  if not both then return stop(INFO, "done") end
  limited(both, step_ms)
  if not vehicle:set_steering_and_throttle(now[2], now[1]) then
    stop(ERROR, "stopped, sticks refused")
  end
end

local function update()
  if state == "running" then
    running()
  end
  if state == "stopping" then  -- in the same step: no moment is lost
    stopping()
  elseif state == "waiting" then
    local high = switch_high()
    if high and ready then start() end
    if not high then ready = true end
  end
end

-- An error in here must not leave the motors as they are.
local function guarded()
  local fine, problem = pcall(update)
  if not fine then
    say(ERROR, "error, " .. string.sub(tostring(problem), -36))
    if state ~= "waiting" then
      state = "stopping"
      pcall(stopping)
    end
  end
  return guarded, STEP_MS
end

say(INFO, "$name loaded, $seconds s")
return guarded, 1000

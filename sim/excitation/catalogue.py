"""The list of all manoeuvres: one line each."""

from sim.excitation.joystick import Joystick
from sim.excitation.legs import Constant, Ramp, Reversals, Square, Steps, Still
from sim.excitation.manoeuvre import Manoeuvre
from sim.excitation.oscillations import Chirp, Mixed, Random, Sinusoid
from sim.excitation.turns import Circles, Spin, Zigzag

MANOEUVRES: tuple[Manoeuvre, ...] = (
    Mixed(),
    Steps(),
    Reversals(),
    Zigzag(),
    Ramp(),
    Chirp(),
    Circles(),
    Spin(),
    Still(),
    Sinusoid(),
    Square(),
    Constant(),
    Random(),
    Joystick(),
)
BY_NAME = {manoeuvre.name: manoeuvre for manoeuvre in MANOEUVRES}

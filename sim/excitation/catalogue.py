"""The list of all manoeuvres: one line each."""

from sim.excitation.chirp import Chirp
from sim.excitation.circles import Circles
from sim.excitation.constant import Constant
from sim.excitation.joystick import Joystick
from sim.excitation.manoeuvre import Manoeuvre
from sim.excitation.mixed import Mixed
from sim.excitation.ramp import Ramp
from sim.excitation.random import Random
from sim.excitation.reversals import Reversals
from sim.excitation.sinusoid import Sinusoid
from sim.excitation.spin import Spin
from sim.excitation.square import Square
from sim.excitation.steps import Steps
from sim.excitation.still import Still
from sim.excitation.zigzag import Zigzag

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

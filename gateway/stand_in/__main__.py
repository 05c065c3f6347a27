"""`python -m gateway.stand_in`: drive a boat in the loop in real time, and send what a radio would.

shadow hil --vessel otter                                   # the boat
python -m gateway.stand_in --vessel otter --mavlink udpout:127.0.0.1:14550
shadow live udpin:127.0.0.1:14550 --vessel otter            # its digital shadow
"""

import argparse
import sys

from gateway.errors import ShadowError
from gateway.simulated_boat.play import BoatPort
from gateway.stand_in.autopilot import StandIn, on_the_air
from gateway.stand_in.pilots import PlanPilot
from gateway.stopping import stop_on_signals
from gateway.vessel_file import load_vessel
from sim.excitation.catalogue import BY_NAME
from sim.excitation.manoeuvre import StickLimits
from sim.excitation.sticks import plan_of
from sim.model import Model


def main() -> int:
    """Until the manoeuvre is over, or Ctrl-C."""
    shape = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(
        prog="python -m gateway.stand_in", description=__doc__, formatter_class=shape
    )
    parser.add_argument("--vessel", required=True, help="whose outputs it drives")
    parser.add_argument("--sensors", default="127.0.0.1:9002", help="where shadow hil json:… is")
    parser.add_argument("--mavlink", required=True, help="udpout:…, udpin:…, tcp:… or tcpin:…")
    parser.add_argument(
        "--excitation", default="mixed", choices=BY_NAME, metavar="NAME", help="shadow plan --list"
    )
    words = parser.parse_args()
    stop = stop_on_signals()
    try:
        vessel = load_vessel(words.vessel)
        limits = StickLimits(throttle=0.7)
        pilot = PlanPilot(plan_of(BY_NAME[words.excitation], Model.of(vessel), limits))
        with BoatPort(words.mavlink) as port:
            StandIn(vessel).drive(
                words.sensors, pilot, float("inf"), each=on_the_air(port), real_time=True,
                stop=stop.is_set,
            )  # fmt: skip
    except ShadowError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_status
    return 0


if __name__ == "__main__":
    sys.exit(main())

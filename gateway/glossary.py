"""Words that the page and the report use, each explained in a sentence."""

GLOSSARY = {
    "nrmse": "size of the error of u, v and r together, in standard deviations of the motion: "
    "0 is perfect, 1 is as bad as knowing only the mean",
    "noise floor": "the error that a perfect model would still show, because sensors are noisy",
    "free run": "the model starts once and is never corrected",
    "horizon": "how long the model runs freely before it is started anew from the measurement",
    "surge u": "speed over ground towards the bow",
    "sway v": "speed over ground towards starboard",
    "yaw rate r": "how fast the boat turns, clockwise from above",
    "missing force": "what the model would need on top of its commanded forces to move as measured",
    "95 % interval": "where the true number lies in 95 of 100 cases like this one",
    "unseen time": "stretches of the recordings that were left out of the fit",
    "ladder": "the error on unseen time after each effect that was added",
    "base": "the nine plain numbers of a vessel: masses and damping",
    "probability": "how likely it is that this effect explains unseen time best: of those ranked, "
    "each alone, and of nothing being missing",
    "effect": "one physical cause that a model may or may not contain: current, thruster lag, …",
    "regime": "a range of speed, heading, throttle, time, … in which the error is looked at",
    "NIS": "how well the filter's stated noise fits what it sees: 1 is honest",
    "clock offset": "the receiver's clock minus the boat's",
    "gated": "measurements refused as outliers since the start",
    "reference": "the velocity that the shadow follows: measured, or predicted by the model",
    "shadow": "the simulated boat that follows the real one",
}

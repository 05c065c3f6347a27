"""Effects from a user's file: they take part, an edit counts at once, mistakes are one line."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.errors import BadInput
from gateway.user_effects import load_effects
from sim.model import Model
from sim.vessel import AddedEffect
from tests.sim.vessels import WAMV, excitation

FILE = '''
"""Square drag of a towed line: X = -k |u| u, k [N s2/m2]."""
from typing import NamedTuple
import numpy as np
from sim.effects.effect import Effect, Parameter, Scope
from sim.state import Wrench

class Parameters(NamedTuple):
    k: float

def force(flow, p):
    """Velocity through the water -> X, Y, N [N, N, N m]."""
    return Wrench(-FACTOR * p.k * np.abs(flow.u) * flow.u, 0.0, 0.0)

EFFECT = Effect("line_drag", Scope.BOAT, (Parameter("k", "N s2/m2", 0.0, 50.0, 5.0),),
                "slower than it should be", force=force)
'''


def speed_with(path):
    """Surge speed [m/s] of WAM-V with the file's effect, at the end of a voyage."""
    (effect,) = load_effects(path)
    model = Model.of(WAMV.with_effects(AddedEffect(effect, {"k": 20.0})))
    assert model.kernel.compiled
    return model.simulate(excitation(WAMV, 10.0, 0.1), 0.1)[0][0, -1, 3]


@pytest.mark.parametrize("laws", ["plain", pytest.param("compiled", marks=pytest.mark.slow)])
def test_a_users_effect_takes_part_and_an_edit_counts_at_the_next_run(tmp_path, request, laws):
    if laws == "plain":
        request.getfixturevalue("plain_laws")
    path = tmp_path / "line.py"
    plain = Model.of(WAMV).simulate(excitation(WAMV, 10.0, 0.1), 0.1)[0][0, -1, 3]
    path.write_text(FILE.replace("FACTOR", "1"))
    once = speed_with(path)
    path.write_text(FILE.replace("FACTOR", "9"))  # same length, within the same second
    ninefold = speed_with(path)
    path.write_text(FILE.replace("FACTOR", "1"))
    assert ninefold < once - 0.05 < plain - 0.1
    assert speed_with(path) == once


@pytest.mark.usefixtures("plain_laws")
def test_the_kernel_holds_the_laws_that_were_loaded_even_if_the_file_changed_since(tmp_path):
    path = tmp_path / "line.py"
    path.write_text(FILE.replace("FACTOR", "1"))
    (effect,) = load_effects(path)
    path.write_text(FILE.replace("FACTOR", "9"))
    (edited,) = load_effects(path)
    commands = excitation(WAMV, 10.0, 0.1)
    ends = [
        Model.of(WAMV.with_effects(AddedEffect(e, {"k": 10.0}))).simulate(commands, 0.1)[0][0, -1]
        for e in (edited, effect)
    ]
    assert ends[0][3] < ends[1][3] - 0.05
    assert "-1 *" in effect.source_code
    assert np.isfinite(ends).all()


def test_a_file_of_release_0_1_says_what_a_parameter_means_under_the_old_name(tmp_path):
    path = tmp_path / "line.py"
    text = FILE.replace("FACTOR", "1")
    path.write_text(text.replace("50.0, 5.0)", '50.0, 5.0, says="of the line")'))
    with pytest.warns(DeprecationWarning, match="parameter k: write description= instead") as seen:
        (old,) = load_effects(path)
    assert seen[0].filename == str(path)
    path.write_text(text.replace("50.0, 5.0)", '50.0, 5.0, description="of the line")'))
    (new,) = load_effects(path)
    assert old.parameters == new.parameters
    assert old.parameters[0].description == "of the line"
    assert replace(old.parameters[0], start=7.0).description == "of the line"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x = 1\n", "defines no Effect"),
        ("def force(:\n", "SyntaxError"),
        ("import no_such_module_anywhere\n", "no_such_module_anywhere"),
        (FILE.replace("force=force", ""), "declares no law"),
    ],
)
def test_a_mistake_in_a_file_is_one_line(tmp_path, text, says):
    path = tmp_path / "wrong.py"
    path.write_text(text)
    with pytest.raises(BadInput, match=says) as caught:
        load_effects(path)
    assert "\n" not in str(caught.value)
    assert "wrong.py" in str(caught.value)


def test_what_is_no_text_or_not_there_is_one_line(tmp_path):
    path = tmp_path / "noise.py"
    path.write_bytes(b"\xff\xfe\x00")
    for wrong in (path, tmp_path / "absent.py", tmp_path):
        with pytest.raises(BadInput) as caught:
            load_effects(wrong)
        assert "\n" not in str(caught.value)

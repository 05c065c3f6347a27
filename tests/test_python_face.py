"""What `import sim` and `import gateway` offer: typed, documented, and running as documented."""

import ast
import inspect
import re
from functools import partial
from importlib import import_module
from pathlib import Path

import matplotlib.figure
import numpy as np
import pytest

import gateway as gw
import sim
from sim.effects.catalogue import named

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
LINES = re.search(r"```python\n(.*?)```", PAGE, re.S)
SIGNATURES = [sim.simulate, sim.compare, sim.add, sim.identify, sim.diagnose, gw.load_vessel,
              gw.save_vessel, gw.load_trials, gw.open_log, gw.plot, gw.example_log]  # fmt: skip


@pytest.mark.parametrize("package", [sim, gw], ids=lambda p: p.__name__)
def test_every_public_name_is_there_for_programs_and_for_type_checkers(package):
    tree = ast.parse(inspect.getsource(package))
    told = {
        alias.asname
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith(package.__name__)
        for alias in node.names
    }
    assert told == set(package.__all__)
    for name in package.__all__:
        thing = getattr(package, name)
        assert inspect.getdoc(thing), name
    assert set(dir(package)) >= set(package.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = package.nonsense


@pytest.mark.parametrize("function", SIGNATURES, ids=lambda f: f.__name__)
def test_public_functions_are_typed(function):
    signature = inspect.signature(function)
    assert signature.return_annotation is not inspect.Signature.empty
    for parameter in signature.parameters.values():
        assert parameter.annotation is not inspect.Parameter.empty, parameter.name


def test_all_that_the_page_documents_exists():
    named = re.findall(r"^::: ([\w.]+)$", PAGE, re.M)
    assert len(named) > 8
    for name in named:
        module, _, leaf = name.rpartition(".")
        assert hasattr(import_module(module), leaf) if module else import_module(leaf)
    members = re.search(r"members: \[(.*)\]", PAGE)
    assert members
    assert set(re.split(r", ?", members.group(1))) <= set(gw.__all__)


FEW = "steady_current heading_offset"  # the fault of the page's recording, and another


@pytest.fixture(
    scope="module",
    params=[FEW, pytest.param("", marks=pytest.mark.slow)],
    ids=["few effects", "whole catalogue"],
)
def notebook(request, tmp_path_factory) -> dict:
    """The ten lines of the page, run as they stand there, and all that they name."""
    assert LINES
    names: dict = {}
    tried = tuple(map(named, request.param.split())) or sim.EFFECTS
    with pytest.MonkeyPatch.context() as patch:
        few = partial(sim.diagnose, settings=sim.DiagnoseSettings(effects=tried))
        patch.setattr(sim, "diagnose", few)
        patch.chdir(tmp_path_factory.mktemp("notebook"))
        exec(LINES.group(1), names)
        assert Path("better.toml").is_file()
        names["again"] = gw.load_vessel("better.toml")
    return names


def test_the_ten_lines_of_the_page_find_what_is_missing_and_the_error_falls(notebook):
    assert notebook["found"].effects == ("heading_offset",)
    before, after = sim.compare(notebook["other"], [notebook["boat"], notebook["better"]])
    assert after.nrmse < 0.5 * before.nrmse
    assert notebook["again"] == notebook["better"]


def test_results_come_as_dicts_and_as_tables(notebook):
    found, trials = notebook["found"], notebook["trials"]
    comparison = sim.compare(trials, notebook["boat"])[0]
    for result in (found, comparison):
        assert result.to_dict()
        assert len(result.to_pandas()) > 1
    table = trials[0].to_pandas()
    assert list(table.columns[:4]) == ["time", "north", "east", "yaw"]
    assert len(table) == len(trials[0])


def test_results_can_be_drawn(notebook):
    found, trials = notebook["found"], notebook["trials"]
    for result in (found, sim.compare(trials, notebook["boat"])):
        figures = gw.plot(result, trials)
        assert figures
        assert all(isinstance(f, matplotlib.figure.Figure) for f in figures.values())


def test_a_simulation_takes_one_column_for_each_actuator():
    boat = gw.load_vessel("wam-v")
    run = sim.simulate(boat, np.full((50, 2), 0.5), 0.1)
    assert run.nu[-1, 0] > 0.5
    assert set(run.to_dict()) >= {"time", "u", "commands"}
    assert len(run.to_pandas()) == 50
    with pytest.raises(ValueError, match="one for each of left, right"):
        sim.simulate(boat, np.zeros((50, 3)), 0.1)


def test_what_is_not_there_is_said(notebook):
    with pytest.raises(ValueError, match="there are fits with"):
        sim.add(notebook["found"], "nonsense")
    with pytest.raises(FileNotFoundError, match="voyage_1"):
        gw.example_log("nonsense")

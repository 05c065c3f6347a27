"""What a compiled function can reach, found by walking its globals: no source is parsed for it."""

import ast
import inspect
import sys
from collections.abc import Iterator
from functools import cache
from types import CodeType, FunctionType

from numba.core.registry import CPUDispatcher


def modules_reached(start, packages):
    """Modules of the packages that stand behind any name which functions use, callees included."""
    found, todo, seen = set(), list(start), set()
    while todo:
        function = todo.pop()
        function = getattr(function, "py_func", function)
        if function in seen:
            continue
        seen.add(function)
        found.add(function.__module__)
        for name in set(_names(function.__code__)) & function.__globals__.keys():
            value = function.__globals__[name]
            if isinstance(value, (FunctionType, CPUDispatcher)):
                todo.append(value)
            elif isinstance(value, type):
                found.add(value.__module__)
            elif not _assigns(function.__module__, name):
                found |= {m for m in _loaded(packages) if _assigns(m, name, value)}
    return {module for module in found if module.partition(".")[0] in packages}


def entries(module):
    """The compiled functions of a module."""
    return [value for value in vars(module).values() if isinstance(value, CPUDispatcher)]


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for const in code.co_consts:
        if isinstance(const, CodeType):
            yield from _names(const)


def _loaded(packages) -> list[str]:
    return [name for name in sys.modules if name.partition(".")[0] in packages]


def _assigns(home, name, value=None) -> bool:
    """Whether a module assigns a constant of that name at its top level (with this very value)."""
    module = sys.modules[home]
    if value is not None and vars(module).get(name) is not value:
        return False
    return name in _assigned(home)


@cache
def _assigned(home) -> set[str]:
    """Names that a module assigns at its top level."""
    nodes = ast.parse(inspect.getsource(sys.modules[home])).body
    targets = [t for n in nodes if isinstance(n, ast.Assign) for t in n.targets]
    return {t.id for x in targets for t in ast.walk(x) if isinstance(t, ast.Name)}

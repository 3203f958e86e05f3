"""Doors of rooms that open on first use.

A room's `__init__.pyi` lists what the room offers, names and modules, as imports that type checkers and
editors read. The door reads the same list, and imports a module when it, or a name of it, is first asked for.
So a module may import a room at its top without waiting for what the room is made of.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import ModuleType


def door(room: str, file: str) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """A package's `__getattr__` and `__dir__`; `room` is its name, `file` its `__init__.py`."""
    homes: dict[str, str] = {}

    def known() -> dict[str, str]:
        """The modules by name, read when they are first needed."""
        if not homes:
            for node in ast.parse(Path(file).with_suffix(".pyi").read_text(encoding="utf-8")).body:
                if isinstance(node, ast.ImportFrom):
                    homes.update(
                        (alias.name, f"{'.' * node.level}{node.module or ''}") for alias in node.names
                    )
        return homes

    def find(name: str) -> object:
        if name.startswith("__") or name not in known():
            raise AttributeError(f"module {room!r} has no attribute {name!r}")
        home = known()[name]
        return import_module(f".{name}", room) if home == "." else getattr(import_module(home, room), name)

    return find, lambda: sorted({*vars(sys.modules[room]), *known()})


class Later(ModuleType):
    """A module that is imported when something of it is first asked for; `name` is its dotted name.

    For files whose first half is read by what must not wait for the second: a recipe's keys and its
    mathematics. Type checkers are shown the module itself.
    """

    def __getattr__(self, name: str) -> object:
        if name.startswith("__"):
            raise AttributeError(name)
        found = getattr(import_module(self.__name__), name)
        setattr(self, name, found)
        return found


def put_off(*names: str) -> None:
    """Have submodules of others' packages executed when something of them is first asked for.

    For what a library imports and never uses. Those that are there already, or nowhere, stay as they are.
    """
    from importlib.util import LazyLoader, find_spec, module_from_spec  # which listings do without

    for name in names:
        spec = None if name in sys.modules else find_spec(name)
        if spec is None or spec.loader is None:
            continue
        spec.loader = LazyLoader(spec.loader)
        module = module_from_spec(spec)
        parent, _, own = name.rpartition(".")
        sys.modules[name] = module
        setattr(sys.modules[parent], own, module)
        spec.loader.exec_module(module)

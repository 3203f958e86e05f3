"""What programs and notebooks do with bands, and the layer that the command line stands on.

Everything is imported when it is first asked for: `ribbon show` must not wait for what draws.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .following import Followed
    from .opening import load_state, open_state, solve
    from .run import OpenRun, open
    from .spectrum import Spectrum
    from .state import OpenState
    from .watching import Note, Stage, Step

__all__ = [
    "Followed",
    "Note",
    "OpenRun",
    "OpenState",
    "Spectrum",
    "Stage",
    "Step",
    "load_state",
    "open",
    "open_state",
    "solve",
]

_HOMES = {
    "Followed": "following",
    "Note": "watching",
    "OpenRun": "run",
    "OpenState": "state",
    "Spectrum": "spectrum",
    "Stage": "watching",
    "Step": "watching",
    "load_state": "opening",
    "open": "run",
    "open_state": "opening",
    "solve": "opening",
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        from importlib import import_module

        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

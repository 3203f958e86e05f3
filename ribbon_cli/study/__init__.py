"""Walking through a config: its stages against solver and store, resume, refinement, branches, removal."""

from ribbon_cli.doors import door

__getattr__, __dir__ = door(__name__, __file__)

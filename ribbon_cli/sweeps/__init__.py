"""Many runs at once: what of a sweep is left, who runs it, where each point stands."""

from ribbon_cli.doors import door

__getattr__, __dir__ = door(__name__, __file__)

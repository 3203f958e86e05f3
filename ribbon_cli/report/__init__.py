"""Tables and comparisons. Reads states, never solves."""

from ribbon_cli.doors import door

__getattr__, __dir__ = door(__name__, __file__)

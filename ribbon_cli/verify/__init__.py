"""Stored results against new ones: numbers computed again from shapes, runs repeated, states compared."""

from ribbon_cli.doors import door

__getattr__, __dir__ = door(__name__, __file__)

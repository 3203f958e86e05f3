"""Surveys: the equilibria that random starts lead to, told apart, followed to finer meshes, and counted."""

from ..doors import door

__getattr__, __dir__ = door(__name__, __file__)

"""Configs: YAML with positions in, checked and resolved records out."""

from ribbon_cli.doors import door

__getattr__, __dir__ = door(__name__, __file__)

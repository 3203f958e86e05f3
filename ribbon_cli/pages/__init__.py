"""Results as HTML pages in one file each: no network, no other files."""

from ribbon_cli.doors import door

__getattr__, __dir__ = door(__name__, __file__)

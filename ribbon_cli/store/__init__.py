"""Runs and states on disk: layout, atomic writes, references, provenance.

Importing this imports neither NumPy nor h5py: listings and completions do without them.
"""

from ribbon_cli.doors import door

__getattr__, __dir__ = door(__name__, __file__)

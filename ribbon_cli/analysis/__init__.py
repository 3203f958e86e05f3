"""What is computed from stored states: tables of energies, spectra and stability, limits, the continuum."""

from ribbon_cli.doors import door

__getattr__, __dir__ = door(__name__, __file__)

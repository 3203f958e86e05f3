"""What an energy term gives: local values, gradients and Hessians, and its derivatives by parameters.

A term is a sum over the local vectors (14, M) of `stencil`. A new one is a class here or in a file of its
own, and a row in `terms.py`; solver, branches, spectra and verification then work with it unchanged.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from .band import Array, Band
from .stencil import SIZE

Couplings = tuple[tuple[str, str], ...]
"""Pairs of blocks of the local vector, from U0, U, G, G1, X0, X in this order, which a Hessian couples
fully."""


class Term:
    """An energy term of one problem; the base class is a term that is zero.

    `parameters` are those that it depends on, besides the half-width. `load` tells the work of loads from
    elastic energy. `couplings` are what its Hessian has beyond the bending energy's.
    """

    parameters: ClassVar[tuple[str, ...]] = ()
    load: ClassVar[bool] = False
    couplings: ClassVar[Couplings] = ()

    def __init__(self, band: Band) -> None:
        self.band = band

    @property
    def active(self) -> bool:
        """Whether it is not zero at the present parameters."""
        return False

    def values(self, local: Array) -> Array:
        """Energies (M,) by node."""
        return np.zeros(local.shape[1])

    def gradient(self, local: Array) -> Array:
        """Their gradients (14, M) in the local vectors."""
        return np.zeros((SIZE, local.shape[1]))

    def add_hessian(self, local: Array, hessian: Array) -> None:
        """Add their Hessians to the upper triangle of hessian (14, 14, M) in place."""

    def rate(self, parameter: str, local: Array) -> tuple[float, Array]:
        """The derivatives by a parameter of the energy, and of the local gradients (14, M)."""
        del parameter
        return 0.0, np.zeros((SIZE, local.shape[1]))

    def second_rate(self, parameter: str, local: Array) -> float:
        """The second derivative of the energy by a parameter."""
        del parameter, local
        return 0.0

    def resultant(self) -> Array:
        """The sum (3,) of a load's forces, in 1/length."""
        return np.zeros(3)

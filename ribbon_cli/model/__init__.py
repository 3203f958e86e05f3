"""The mathematics: state, energy, constraints, derivatives, geometry, topology. Knows no solver, no file."""

from ..doors import put_off

# scipy takes in all that numpy offers: these two, of no use here, take a sixth of the time until it is there.
put_off("numpy.f2py", "numpy.testing")

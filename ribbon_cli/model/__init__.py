"""The mathematics: state, energy, constraints, derivatives, geometry, topology. Knows no solver, no file."""

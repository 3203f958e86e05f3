"""KKT linear algebra and inertia, saddle-free Newton, prolongation, continuation, spectra."""

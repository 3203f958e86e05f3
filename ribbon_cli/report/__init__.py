"""Tables, plots and exports. Reads states, never solves."""

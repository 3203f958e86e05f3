"""States and branches in the formats of other programs. Reads stored states, never solves."""

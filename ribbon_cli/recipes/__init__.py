"""Initial guesses, one file each."""

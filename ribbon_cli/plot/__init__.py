"""Pictures of stored states and runs in one style. Reads stored states, never solves."""

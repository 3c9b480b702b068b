"""People's part in a run beside programs: the orders they type, and the operator that carries them out."""

"""The part that people take in a run beside programs: the orders they type, and who carries them out."""

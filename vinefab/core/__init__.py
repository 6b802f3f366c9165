"""Foundations that know nothing of robots: errors, units, registries, seeds, hashes, files."""

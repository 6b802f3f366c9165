"""Foundations that know nothing of robots: errors, registries, seeds, statistics, safe files."""

"""Generators of maps and the geometry that turns imported data into maps."""

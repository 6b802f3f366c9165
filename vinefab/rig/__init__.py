"""Printable test rigs of maps."""

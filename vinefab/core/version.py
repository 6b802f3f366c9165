"""The version of vinefab, where every room may read it: the top of the package sees all rooms."""

__version__ = "0.1.0"

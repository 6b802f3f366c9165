"""vinefab: design, simulate, optimize and make branching vine robots."""

__version__ = "0.1.0"

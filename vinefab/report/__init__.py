"""Numbers into figures into one self-contained page."""

"""How fast growth and search are."""

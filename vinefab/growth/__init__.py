"""How a design deploys on a map: compiled kernel, readable twin, and the front door."""

"""How a design deploys on a map: compiled kernel, readable twin, terrain, growths and batches."""

"""One file per format: a foreign file in, a map out."""

"""One file per format: a file of another program in, a map out; ``importers`` lists them."""

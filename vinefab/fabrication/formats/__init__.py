"""One file per laser format: writer, reader and tolerance."""

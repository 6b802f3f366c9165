"""The only room that knows the file formats going out."""

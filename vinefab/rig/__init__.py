"""Printable and laser-cut test rigs of maps: solids, files, pictures and page."""

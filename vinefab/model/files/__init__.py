"""File forms of the nouns: TOML, GeoJSON and JSON, and the shipped files by name."""

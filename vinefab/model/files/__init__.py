"""The file forms of the nouns: TOML, GeoJSON and JSON in and out, and what is shipped."""

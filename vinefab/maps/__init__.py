"""Maps: generators of related maps, importers of foreign ones, cleanup, poses and passages."""

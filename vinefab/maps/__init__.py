"""Maps: generated, imported, and measured.

What other rooms use:

- ``generators.environments.ENVIRONMENTS``: generators by name, each with its options class;
  ``grid_map``, ``cave_map``, ``corridors_map``, ``pegs_map`` and ``rubble_map`` in the file of
  their name; ``generators.generated_map.option_fields`` for lists of options.
- ``importers.importers.import_map`` (with ``importers.source_drawing.ImportOptions``),
  ``IMPORTERS`` and ``import_suffixes``.
- ``poses.draw_poses``: poses from the starts of a map. ``passages.narrow_passages``: its narrowest
  places.

``cleanup`` serves the importers only. Files of vinefab's own maps are read and written by
``vinefab.model.files.map_geojson``.
"""

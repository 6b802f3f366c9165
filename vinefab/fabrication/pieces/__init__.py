"""Robots in flat pieces: which branches to cut, and what lies on each piece.

Others use `partition_of` (`partition.py`), and a search `quick_cuts` (`quick_cuts.py`), which takes
microseconds compiled (`vinefab.search.penalty_kernel`) and is hardly ever worse; the nouns are in `vinefab.model.pieces`, the size of a
sleeve is in `vinefab.fabrication.job.sleeve`.
"""

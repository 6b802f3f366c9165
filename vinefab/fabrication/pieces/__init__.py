"""Robots in flat pieces: which branches to cut, and what lies on each piece.

Others use `partition_of` (`partition.py`); the nouns are in `vinefab.model.pieces`, the size of a
sleeve is in `vinefab.fabrication.job.sleeve`.
"""

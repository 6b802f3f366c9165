"""Robots in flat pieces: sleeves, which branches to cut, and the outlines of the pieces.

Others use `partition_of` (`partition.py`), `piece_outline` (`piece_outline.py`) and `sleeve_size`
(`sleeve.py`); the nouns are in `vinefab.model.pieces`.
"""

"""Robots in flat pieces: the branches to cut, and the content of each piece.

Others use `partition_of` (`partition.py`). A search takes the cuts of its compiled penalty
(`vinefab.search.penalty_kernel`): microseconds, and hardly ever worse. The nouns are in
`vinefab.model.tree`, the size of a sleeve is in `vinefab.fabrication.job.passes`.
"""

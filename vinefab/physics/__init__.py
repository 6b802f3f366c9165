"""Physics of inflated film tubes: small pure functions, each with its source and standing.

Other rooms use ``tube`` (inflated size, collapse of free spans; seams: spot, line load, burst
pressure), ``growth_pressure`` (capstan, paths through a tree, growth pressure) and
``anchoring`` (pouch force, amplification, payload). Pressures are gauge pressures.
"""

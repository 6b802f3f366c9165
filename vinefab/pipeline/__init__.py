"""Whole jobs over the rooms: what the commands, and any other front end, call.

A job takes nouns and gives nouns, text or bytes; reading and writing files is its caller's. Each
job is a module of its own, so that cutting a saved design does not load the simulator.
"""

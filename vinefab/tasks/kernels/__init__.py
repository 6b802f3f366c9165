"""Compiled inner loops of tasks; each file imports nothing of ours but how to compile."""

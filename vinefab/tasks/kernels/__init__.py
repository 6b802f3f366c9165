"""Compiled inner loops of tasks; each file imports no module of vinefab but `core.compiling`."""

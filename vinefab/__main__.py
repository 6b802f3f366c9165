"""Run the program with ``python -m vinefab``."""

from vinefab.cli.main import run

run()

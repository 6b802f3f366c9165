"""The record of a run: one SQLite file.

`result` has the nouns (`Generation`, `Finalist`, `RunResult`, `RunIdentity`), `store` writes a
record (`RunStore`, `Recorder`), `run_archive` reads one (`RunArchive`, `records_in`).
"""

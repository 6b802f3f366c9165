"""The record of a run: one SQLite file.

`generations` has its nouns (`Generation`, `Finalist`, `RunIdentity`), `store` writes a record
(`RunStore`, `Recorder`), `result` reads one (`RunArchive`, `RunResult`, `records_in`).
"""

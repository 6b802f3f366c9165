"""The public functions of vinefab, one per verb: Python calls them and the commands run them.

`verbs` lists them with the words of their commands; `vinefab.cli` makes the command line from
their signatures and docstrings. A verb takes what a user has (a name, a path, an object), calls
the rooms below and returns one result with ``summary``, its lines, and ``json_text()``.

Imports inside functions: here, and nowhere else, a function imports its rooms when it is called,
so that a help or a check does not wait for the simulator. They are plain imports and not a lazy
loader's strings: import-linter and mypy see them.
"""

"""The search for a design: space, evaluation, loop, finalists, fronts and whole runs."""

"""The command line, made from the verbs: this package knows no feature."""

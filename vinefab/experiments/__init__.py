"""The paper's experiments, each a short script over the rooms above."""

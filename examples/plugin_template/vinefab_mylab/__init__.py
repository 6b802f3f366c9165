"""Parts of my lab for vinefab; `pyproject.toml` names them."""

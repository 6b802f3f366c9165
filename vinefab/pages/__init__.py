"""What rooms share to show things: figures, drawings of nouns, animations, the page."""

"""From a design to its exact outline of lines and arcs."""

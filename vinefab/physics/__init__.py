"""Pressure, film and friction: small pure functions, each with its source."""

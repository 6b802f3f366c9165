"""Tube, seam, capstan, growth pressure, anchoring: small pure functions, each with its source."""

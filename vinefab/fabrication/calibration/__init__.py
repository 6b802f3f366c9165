"""Coupons out, readings in, a calibrated recipe out."""

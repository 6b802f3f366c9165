"""Foundations that know nothing of robots; every room may use them.

``errors``, ``registry`` (named parts and plug-ins), ``validation`` (checks and read-only arrays),
``units``, ``rng`` (seeded generators), ``statistics``, ``compiling`` (numba), ``jsontext``,
``hashing`` (digests and manifests), ``atomic`` (safe writing) and ``lock``.
"""

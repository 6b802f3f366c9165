"""Foundations that know nothing of robots; every room may use them.

``errors``, ``registry`` (named parts and plug-ins), ``validation`` (checks and read-only arrays),
``units``, ``rng`` (seeded generators), ``statistics``, ``compiling`` (numba), ``jsontext``,
``hashing`` (digests, manifests, marks of files), ``atomic`` (safe writing, locks of folders) and
``bounded`` (foreign files under limits).
"""

"""Foundations that know nothing of robots; every room may use them.

``errors``, ``registry`` (named parts and plug-ins), ``limits`` (numbers within limits, angles),
``validation`` (arrays, read-only), ``rng`` (seeded generators), ``statistics``, ``compiling``
(numba), ``front_door`` (modules that are loaded later), ``plain_text`` (words and JSON),
``hashing`` (digests, manifests, marks of files),
``atomic`` (safe writing of files and folders, locks), ``bounded`` (foreign files under limits),
``table`` (declared tables), ``verbs`` (public functions, their progress) and ``view`` (results).
"""

__version__ = "0.2.0"
"""Here, where every room and the build may read it: the top of the package sees all rooms."""

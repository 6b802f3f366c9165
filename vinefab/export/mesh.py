"""What a list of triangles, as read from a file, encloses: closed, oriented, one piece, how large.

Written for files of solids: corners are the same when their coordinates are, to the last digit.
No general mesh library is loaded: it would take a second, and swallow an interrupt meanwhile.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from vinefab.model.checked import Floats, Ints


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mesh:
    """Triangles as a file gives them.

    Parameters
    ----------
    vertices_mm
        Corners, shape (n, 3), all different.
    faces
        Corner indices, shape (m, 3).
    """

    vertices_mm: Floats
    faces: Ints

    @classmethod
    def of_corners(cls, corners_mm: Floats) -> "Mesh":
        """Return the mesh of triangles that are given by their corners, shape (m, 3, 3)."""
        points = np.ascontiguousarray(corners_mm, dtype=np.float64).reshape(-1, 3) + 0.0
        vertices, index = np.unique(points, axis=0, return_inverse=True)
        return cls(vertices_mm=vertices, faces=np.asarray(index, dtype=np.int64).reshape(-1, 3))

    @property
    def volume_mm3(self) -> float:
        """Volume enclosed; negative when the triangles face inward."""
        middle = self.vertices_mm.mean(axis=0)
        a, b, c = np.moveaxis((self.vertices_mm - middle)[self.faces], 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)

    @property
    def box_mm(self) -> Floats:
        """Lowest and highest corner, shape (2, 3)."""
        return np.array([self.vertices_mm.min(axis=0), self.vertices_mm.max(axis=0)])

    def form_problems(self) -> list[str]:
        """Return why the triangles do not bound one solid, in words; nothing when they do."""
        edges = self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        if (edges[:, 0] == edges[:, 1]).any():
            return ["has triangles without an area"]
        owner = np.repeat(np.arange(len(self.faces)), 3)
        low, high = edges.min(axis=1), edges.max(axis=1)
        key = low * len(self.vertices_mm) + high
        order = np.argsort(key, kind="stable")
        _, first, count = np.unique(key[order], return_index=True, return_counts=True)
        closed = bool((count == 2).all())
        pairs = order[first[count == 2]], order[first[count == 2] + 1]
        one, other = (edges[pair, 0] < edges[pair, 1] for pair in pairs)
        adjacent = coo_array(
            (np.ones(len(pairs[0]), dtype=np.int8), (owner[pairs[0]], owner[pairs[1]])),
            shape=(len(self.faces), len(self.faces)),
        )
        oriented = bool((one != other).all())
        said = {
            "is not closed: an edge has not exactly two triangles": closed,
            "has triangles that face different ways": oriented,
            "is no solid: open, or inside out": closed and oriented and self.volume_mm3 > 0.0,
            "is more than one piece": connected_components(adjacent, directed=False)[0] == 1,
        }
        return [text for text, holds in said.items() if not holds]

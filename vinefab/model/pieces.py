"""A robot cut in flat pieces: which branches each holds, and the sleeves that join them."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """A connected part of the branch tree that lies flat by itself.

    Branches are named by their index in the tree.
    """

    label: str  # A for the piece with the tail, then B, C, ...; AA after Z
    root: int  # the branch that it begins with: the trunk (0), or one that begins in a socket
    branches: tuple[int, ...]  # the branches that end on it, its root among them, ascending
    stubs: tuple[int, ...] = ()  # the branches of which only the stub with its plug is on it


@dataclass(frozen=True, slots=True, kw_only=True)
class Sleeve:
    """Where two pieces meet: a socket over a plug, on a straight stretch of one branch.

    Distances are along the branch, from the joint or base where it begins.
    """

    label: str  # that of the outer piece, the one with the socket
    inner: str  # label of the piece with the plug
    branch: int  # index of the branch
    socket_mm: float  # where the socket begins
    plug_mm: float  # where the plug ends: one lap farther
    blend_end_mm: float  # where the socket's blend ends and the branch has its own width
    width_mm: float  # lay-flat lumen width of the branch where the socket begins


@dataclass(frozen=True, slots=True, kw_only=True)
class Unparted:
    """Bodies that must not lie on one piece, and that no cut parts."""

    why: str  # what happens where they lie on one piece: a predicate
    branches: tuple[int, ...]  # indices of the branches concerned
    between: tuple[int, ...]  # branches that would part them, had one of them the room
    room_mm: float  # longest straight side among these
    needed_mm: float  # straight side that a sleeve takes


@dataclass(frozen=True, slots=True, kw_only=True)
class Partition:
    """A robot in pieces; one that cannot be parted stays whole."""

    # from the base outward: the piece with the tail first; the whole robot if it is not cut
    pieces: tuple[Piece, ...]
    sleeves: tuple[Sleeve, ...] = ()  # of all pieces but the first, in their order
    proven_least: bool = True  # whether no fewer pieces are possible
    # Whether even these pieces do not pass: the search for the least number was given up, as it is
    # beyond what the design allows.
    unfinished: bool = False
    unparted: tuple[Unparted, ...] = ()  # why it cannot be cut in pieces that lie flat; else none

    def sleeve(self, branch: int) -> Sleeve:
        """Return the sleeve on a branch that is cut, by the branch's index."""
        return next(sleeve for sleeve in self.sleeves if sleeve.branch == branch)


def piece_label(number: int) -> str:
    """Return the label of a piece by its number from 0.

    >>> [piece_label(number) for number in (0, 25, 26)]
    ['A', 'Z', 'AA']
    """
    first, last = divmod(number, 26)
    return (piece_label(first - 1) if first else "") + chr(ord("A") + last)

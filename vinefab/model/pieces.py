"""A robot cut in flat pieces: which branches each holds, and the sleeves that join them."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """A connected part of the branch tree that lies flat by itself.

    Branches are named by their index in the tree.
    """

    label: str  # A for the piece with the tail, then B, C, ...; AA after Z
    root: int  # the branch that it begins with: the trunk (0), or one that is cut
    branches: tuple[int, ...]  # the branches that end on it, its root among them, ascending
    stubs: tuple[int, ...] = ()  # the branches of which only the stub is on it


@dataclass(frozen=True, slots=True, kw_only=True)
class Sleeve:
    """Where two pieces meet: a plug in a socket, on a straight stretch of one branch.

    Distances are along the branch, from the joint or base where it begins. The plug is the stub's
    end, or where the stub has the socket the outer piece's base.
    """

    label: str  # that of the outer piece
    inner: str  # label of the piece with the stub
    branch: int  # index of the branch
    socket_mm: float  # rim of the socket
    plug_mm: float  # rim of the plug, one lap away
    blend_end_mm: float  # where the socket's blend ends and the branch has its own width
    rise_mm: float  # how far the socket's lumen edge lies outside the branch's, on each side
    width_mm: float  # lay-flat lumen width of the branch where the lap begins

    @property
    def socket_on_stub(self) -> bool:
        """Whether the outer piece goes into the stub, not over it."""
        return self.plug_mm < self.socket_mm

    @property
    def plug_on(self) -> str:
        """Label of the piece with the plug."""
        return self.label if self.socket_on_stub else self.inner

    @property
    def socket_on(self) -> str:
        """Label of the piece with the socket."""
        return self.inner if self.socket_on_stub else self.label

    @property
    def outer_from_mm(self) -> float:
        """Where the outer piece begins, and the lap."""
        return min(self.socket_mm, self.plug_mm)

    @property
    def stub_to_mm(self) -> float:
        """Where the stub ends, and the lap."""
        return max(self.socket_mm, self.plug_mm)

    @property
    def lap_mm(self) -> float:
        """How deep the plug goes into the socket."""
        return self.stub_to_mm - self.outer_from_mm


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

"""Memory for the results of one block of growths after the other."""

from vinefab.growth.arrays import Growth


class Scratch:
    """Arrays that are made once and used again: asking for memory costs as much as growing."""

    __slots__ = ("_growth",)

    def __init__(self) -> None:
        self._growth = Growth.empty(0, 0)

    def growth(self, jobs: int, branches: int, room: int) -> Growth:
        """Return cleared arrays for several trees one after the other.

        Parameters
        ----------
        jobs
            Number of trees. Each has its own ``first_point``, one entry longer than it has
            branches.
        branches, room
            Branches and chain points of all of them together.
        """
        held = self._growth
        if branches + jobs >= len(held.first_point) or room > len(held.points):
            held = self._growth = Growth.empty(2 * (branches + jobs), 2 * room)
        part = Growth(
            points=held.points[:room],
            first_point=held.first_point[: branches + jobs],
            stop=held.stop[:branches],
            grown=held.grown[:branches],
            turn=held.turn[:branches],
            heading=held.heading[:branches],
            events=held.events[:branches],
            steep=held.steep[:branches],
            chain_length=held.chain_length[:room],
            chain_sense=held.chain_sense[:room],
        )
        for array in (
            part.first_point,
            part.stop,
            part.grown,
            part.turn,
            part.heading,
            part.events,
            part.steep,
        ):
            array.fill(0)
        return part

"""An environment: round posts in a room, as on our bench."""

import math
from dataclasses import dataclass

import shapely

from vinefab.core.rng import child
from vinefab.maps.generators.environments import Environment
from vinefab.model.map import Map, Pose, Start

_STREAM = 7001  # any number of your own: posts do not depend on other draws


@dataclass(frozen=True, slots=True, kw_only=True)
class PostsOptions:
    """Sizes; each field becomes an option of ``vinefab map posts``.

    Parameters
    ----------
    size_mm
        Side of the square room.
    posts
        How many are tried; one that is too near another is left out.
    radius_mm
        Of a post.
    gap_mm
        Least gap between posts.
    """

    size_mm: float = 400.0
    posts: int = 12
    radius_mm: float = 15.0
    gap_mm: float = 60.0


def posts_map(seed: int, options: PostsOptions) -> Map:
    """Return the room of a seed."""
    rng = child(seed, _STREAM)
    room = shapely.box(0.0, 0.0, options.size_mm, options.size_mm)
    apart_mm = 2.0 * options.radius_mm + options.gap_mm
    middles: list[tuple[float, float]] = []
    for x_mm, y_mm in rng.uniform(apart_mm, options.size_mm - apart_mm, (options.posts, 2)):
        if all(math.dist((x_mm, y_mm), other) >= apart_mm for other in middles):
            middles.append((float(x_mm), float(y_mm)))
    posts = tuple(shapely.Point(middle).buffer(options.radius_mm) for middle in middles)
    pose = Pose(x_mm=options.size_mm / 2.0, y_mm=options.radius_mm, heading_rad=math.pi / 2.0)
    start = Start(pose=pose, spread_heading_rad=math.radians(20.0))
    return Map(
        name=f"posts_{seed}",
        bounds=room,
        obstacles=posts,
        starts=(start,),
        environment="posts",
        seed=seed,
    )


POSTS = Environment(description="round posts in a room", options=PostsOptions, make=posts_map)

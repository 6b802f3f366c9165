"""The simulator of one design on one map from one pose."""

from vinefab.growth.batch import Batch, Launches, TerrainSet
from vinefab.growth.engine import Engine
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plan, Plans
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.map import Pose


def grow_on(
    design: Design,
    terrain: Terrain,
    pose: Pose,
    options: GrowthOptions | None = None,
    engine: Engine = "auto",
    plan: Plan | None = None,
) -> Deployment:
    """Return how a design deploys from a pose: a batch of one.

    Parameters
    ----------
    design
        The robot.
    terrain
        The map, prepared with `Terrain.of`.
    pose
        Where the trunk is launched. A start on a wall is allowed.
    options
        Options of the growth model; the defaults if None.
    engine
        What computes it, see `Engine`.
    plan
        The branches to grow, such as a part of the design's, cut shorter; the design's if None.

    Returns
    -------
    Deployment
        Chains, stop reasons, lengths and turns. A branch that stopped at once has a chain of two
        equal points; one that never emerged has none. With inflated bodies, a branch without room
        for its base has not deployed.

    Raises
    ------
    BadInputError
        If the pose is inside an obstacle or outside the bounds.
    UnknownNameError
        If there is no such engine.
    """
    options = options or GrowthOptions()
    launches = Launches.of(TerrainSet([terrain]), [[pose]], [options.only_half_angle_rad])
    plans = Plans.joined([plan or Plan.of(design, options)])
    (deployment,) = Batch(plans, launches, options, engine=engine).deployments()
    return deployment

"""Deployments as JSON, ``vinefab/deployment-1``."""

from collections.abc import Mapping, Sequence

from vinefab.core.jsontext import json_text
from vinefab.core.units import deg
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.map import Pose

DEPLOYMENT_SCHEMA = "vinefab/deployment-1"


def deployment_text(
    deployment: Deployment,
    design_name: str,
    map_name: str,
    metrics: Mapping[str, object],
    history: Sequence[Mapping[str, object]] | None = None,
    more: Mapping[str, object] | None = None,
) -> str:
    """Return a deployment as JSON: lengths in mm, angles in degrees.

    Parameters
    ----------
    history
        Earlier shapes, plain values; left out when None.
    more
        What else stands in it, plain values.
    """
    content = {} if history is None else {"history": list(history)}
    return json_text(
        DEPLOYMENT_SCHEMA,
        {
            "design": design_name,
            "map": map_name,
            "pose": pose_content(deployment.pose),
            "branches": branches_content(deployment),
            "metrics": dict(metrics),
            **(more or {}),
            **content,
        },
    )


def branches_content(deployment: Deployment) -> list[dict[str, object]]:
    """Return the branches of a deployment as in our JSON files."""
    names = deployment.tree.ids
    return [_branch(deployment, names, index) for index in range(len(names))]


def pose_content(pose: Pose) -> dict[str, float]:
    """Return a pose as in our JSON files."""
    return pose.content


def _branch(deployment: Deployment, names: tuple[str, ...], index: int) -> dict[str, object]:
    tree = deployment.tree
    parent = int(tree.parent[index])
    return {
        "id": names[index],
        "parent": None if parent < 0 else names[parent],
        "level": int(tree.level[index]),
        "points_mm": deployment.chain_mm(index).tolist(),
        "planned_mm": float(tree.length_mm[index]),
        "grown_mm": float(deployment.grown_mm[index]),
        "stop": Stop(int(deployment.stop[index])).label,
        "contact_turn_deg": deg(float(deployment.contact_turn_rad[index])),
        "joint_deg": deg(float(tree.offset_rad[index])),
        "contacts_mm": deployment.contacts_mm(index).tolist(),
    }

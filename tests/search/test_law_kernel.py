"""The compiled law of single joints against its readable twin."""

import numpy as np
import pytest

from vinefab.core.compiling import interpreted
from vinefab.inflation.law import FILLET, RATIO, STRAIN, Joints, gap_fillets, law_of, network
from vinefab.search import law_kernel


def drawn(count: int) -> tuple[Joints, np.ndarray]:
    """Return joints within the law's range, a fifth of them bends, and the children's fillets."""
    random = np.random.default_rng(5)
    children = random.integers(1, 5, count)
    ratios = random.uniform(*RATIO, (count, 4))
    own = random.uniform(*FILLET, (count, 4))
    is_bend = (children == 1) & (random.uniform(size=count) < 0.8)
    ratios[is_bend] = 1.0
    there = np.arange(4) < children[:, None]
    is_straight = is_bend & (random.uniform(size=count) < 0.3)
    joints = Joints(
        angles_deg=np.where(
            there & ~is_straight[:, None],
            np.sort(random.uniform(-105.0, 105.0, (count, 4)), axis=1),
            0.0,
        ),
        count=children,
        ratios=np.where(there, ratios, 0.0),
        fillets=gap_fillets(own, children),
        strain=random.uniform(*STRAIN, count),
        is_bend=is_bend,
    )
    return joints, own


@pytest.mark.parametrize("how", ["interpreted", "compiled"])
def test_it_is_its_twin(how):
    joints, own = drawn(40 if how == "interpreted" else 400)
    kernel = interpreted("vinefab.search.law_kernel") if how == "interpreted" else law_kernel
    net, told, m = network("flat"), law_of("flat", joints), len(joints.count)
    flat, back, aside = (np.full((m, 4), np.nan) for _ in range(3))
    passage, room = np.empty(m), np.empty((3, max(net.first.shape)))
    kernel.flat_joints(
        net.first, net.second, net.last, np.radians(joints.angles_deg), joints.count,
        joints.ratios, own, joints.strain, joints.is_bend, room, flat, back, aside, passage,
    )  # fmt: skip
    np.testing.assert_allclose(np.degrees(flat), told.angles_deg, atol=1e-9)
    np.testing.assert_allclose(back, told.pull_backs, atol=1e-9)
    np.testing.assert_allclose(aside, told.side_offsets, atol=1e-9)
    np.testing.assert_allclose(np.minimum(passage, 1.0), told.passages, atol=1e-9)

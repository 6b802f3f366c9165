"""Random trees of branches with bends, widths, tapers, fillets and pouches of their own."""

import numpy as np

from vinefab.model.design import Branch, Build, Design, Pouch


def random_free_tree(random, most_branches=60):
    """A tree of 2 to 60 branches; most have an exact outline, whether or not they cross."""
    count = int(random.integers(1, most_branches))
    names, room = ["trunk"], {"trunk": int(random.integers(1, 4))}
    widths = {"trunk": float(random.uniform(25.0, 45.0))}
    ends, branches, depth, free = dict(widths), [], {"trunk": 1}, {"trunk": None}
    for number in range(count):
        open_ = [name for name in names if room[name] and ends[name] > 2.5]
        if not open_:
            break
        of, name = str(random.choice(open_)), f"b{number}"
        if free[of] is None:  # children a good angle apart, in any order
            free[of] = random.permutation(
                np.linspace(-75.0, 75.0, room[of]) + random.uniform(-12.0, 12.0, room[of])
                if room[of] > 1
                else random.uniform(-70.0, 70.0, 1)
            ).tolist()
            continues = room[of] == 1 and random.random() < 0.5
        else:
            continues = False
        room[of] -= 1
        angle = float(free[of].pop())
        width = ends[of] * (1.0 if continues else float(random.uniform(0.35, 0.62)))
        taper = float(random.choice([1.0, random.uniform(0.75, 1.0)]))
        bends, at = [], width * random.uniform(2.5, 4.0)
        for _ in range(int(random.integers(0, 4))):
            bends.append((float(at), float(random.choice([-1, 1]) * random.uniform(10.0, 75.0))))
            at += width * random.uniform(2.5, 4.0)
        pouch = None
        if random.random() < 0.2:
            pouch = Pouch(shape="round", radius_mm=width * float(random.uniform(0.7, 1.2)))
        elif random.random() < 0.2:
            side = width * float(random.uniform(1.3, 2.2))
            pouch = Pouch(shape="rectangle", length_mm=1.2 * side, width_mm=side)
        branches.append(
            Branch(
                name=name,
                of=of,
                angle_deg=angle,
                length_mm=float(at + width * random.uniform(1.0, 3.0) + 1.5 * ends[of]),
                bends=tuple(bends) or None,
                width_mm=width,
                taper=taper,
                fillet_mm=float(random.choice([0.0, 0.25, 0.5])) * width,
                pouch=pouch if pouch is not None else False,
            )
        )
        names.append(name)
        widths[name], ends[name] = width, width * taper
        room[name], free[name] = int(random.integers(0, 4)), None
        depth[name] = depth[of] + 1
    trunk = widths["trunk"]
    bends = ((2.5 * trunk, float(random.uniform(-60.0, 60.0))),) if random.random() < 0.7 else ()
    return Design.of_branches(
        branches,
        trunk_length_mm=6.0 * trunk,
        trunk_bends=bends,
        build=Build(trunk_width_mm=trunk),
        name="free",
    )

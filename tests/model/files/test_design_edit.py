import tomllib
from typing import get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vinefab.core.errors import BadInputError, CannotWriteError, UnreadableFileError
from vinefab.core.limits import rad
from vinefab.model.design import (
    Branch,
    Build,
    Collar,
    Design,
    Level,
    Mounting,
    PieceSettings,
    Pouch,
    Waiver,
    default_fillets_mm,
    design_of,
    design_text,
)
from vinefab.model.files.design_edit import comments_in, edited_text
from vinefab.model.files.shipped import locate, names, read_text

COMMENTED = """\
# A robot for the bench, by hand.
schema = "vinefab/design-1"   # the form of this file
name = "six"
scale_mm_per_unit = 2.0  # drawn in half size

[trunk]
length = 120            # from the base

# The first fan.
[[level]]
branches = 3  # as in the paper
length = 90.0
angle_deg = 100.0     # wide

# The second fan.
[[level]]
branches = 2
length   =   45.5     # short ones
growth_percent = 80   # clockwise-most is longest

# How it is made.
[build]
widths_mm = [
    40.0,  # trunk
    24.0,  # first
    14.0,  # second
]
tail_mm = 250.0
pouch = { shape = "round", radius_mm = 16.0 }   # jams in gaps

# Looked at on the bench:
[[waive]]
fingerprint = "abc"
reason = "tested # twice"

[limits.VF-C01]
warning = 6  # the cutter is good

[origin]
run = "r1"
notes = '''a # b
# not a comment'''
# the end
"""


def read(text: str) -> Design:
    return design_of(tomllib.loads(text.removeprefix("\ufeff")), "test")


def comments(text: str) -> list[str]:
    return sorted(comment for _, comment in comments_in(text))


def changed(text: str, **changes) -> tuple[str, Design]:
    design = read(text).changed(**changes)
    result = edited_text(text, design, "test")
    assert read(result) == design
    assert comments(result) == comments(text)
    return result, design


def new_lines(old: str, new: str) -> list[str]:
    return [line for line in new.splitlines() if line not in old.splitlines()]


def with_level(design: Design, index: int, **changes) -> tuple[Level, ...]:
    levels = list(design.levels)
    levels[index] = levels[index].changed(**changes)
    return tuple(levels)


@pytest.mark.parametrize("name", names("design"))
def test_an_unchanged_design_is_the_same_text(name):
    text = read_text(locate("design", name))
    for variant in (text, text.replace("\n", "\r\n"), "\ufeff" + text, text.rstrip("\n")):
        assert edited_text(variant, read(variant), name) == variant


def test_one_angle_changes_one_value_in_one_line():
    design = read(COMMENTED)
    text, _ = changed(COMMENTED, levels=with_level(design, 0, fan_rad=rad(112.5)))
    assert text == COMMENTED.replace("angle_deg = 100.0     #", "angle_deg = 112.5     #")


def test_lengths_are_divided_by_the_scale_and_written_short():
    design = read(COMMENTED)
    text, _ = changed(
        COMMENTED, trunk_length_mm=0.1 + 0.2, levels=with_level(design, 1, length_mm=91.2)
    )
    assert new_lines(COMMENTED, text) == [
        "length = 0.15000000000000002            # from the base",
        "length   =   45.6     # short ones",
    ]


def test_windows_lines_a_mark_at_the_beginning_and_no_newline_at_the_end_stay():
    for make in (
        lambda text: text.replace("\n", "\r\n"),
        lambda text: "\ufeff" + text,
        lambda text: text.rstrip("\n"),
        lambda text: text.replace("\n", "\r\n").rstrip(),
    ):
        old = make(COMMENTED)
        design = read(old)
        levels = (*with_level(design, 0, branches=4), Level.of(2, 30.0, 60.0))
        build = design.build.changed(widths_mm=(40.0, 24.0, 14.0, 9.0), fillet_mm=(6.0, 3.5, 2.0))
        text, _ = changed(old, levels=levels, build=build)
        assert text.startswith("\ufeff") == old.startswith("\ufeff")
        assert text.endswith("\n") == old.endswith("\n")
        assert ("\r\n" in text) == ("\r\n" in old)
        assert "\n" not in text.replace("\r\n", "") or "\r\n" not in old


def test_a_new_level_stands_before_the_comment_of_the_next_table():
    design = read(COMMENTED)
    build = design.build.changed(widths_mm=(40.0, 24.0, 14.0, 9.0), fillet_mm=(6.0, 3.5, 2.25))
    text, _ = changed(COMMENTED, levels=(*design.levels, Level.of(2, 30.0, 60.0)), build=build)
    added = text.index("branches = 2\nlength = 15.0\nangle_deg = 60.0\ngrowth_percent = 100.0\n")
    assert text.index("clockwise-most") < added < text.index("# How it is made.")
    assert "    14.0,  # second\n    9.0,\n]" in text


def test_a_level_in_the_middle_leaves_the_comments_with_the_others():
    design = read(COMMENTED)
    levels = (design.levels[0], Level.of(5, 60.0), design.levels[1])
    build = design.build.changed(widths_mm=(40.0, 24.0, 18.0, 14.0), fillet_mm=(6.0, 4.5, 3.5))
    text, _ = changed(COMMENTED, levels=levels, build=build)
    assert text.index("# wide") < text.index("branches = 5") < text.index("# The second fan.")
    assert "24.0,  # first\n    18.0,\n    14.0,  # second" in text


def test_a_level_removed_leaves_the_others_and_its_comments():
    design = read(COMMENTED)
    build = design.build.changed(widths_mm=(40.0, 14.0), fillet_mm=(3.5,))
    text, _ = changed(COMMENTED, levels=design.levels[1:], build=build)
    assert "length   =   45.5     # short ones" in text
    assert "    14.0,  # second" in text
    assert text.index("# wide") < text.index("# How it is made.")
    none, _ = changed(
        COMMENTED, levels=(), build=design.build.changed(widths_mm=(40.0,), fillet_mm=())
    )
    assert "[[level]]" not in none


def test_a_level_of_a_plain_vine_follows_the_trunk():
    text, _ = changed(
        design_text(read(COMMENTED.partition("# The first")[0] + "[build]\ntail_mm = 9\n")),
        levels=(Level.of(2, 30.0),),
        build=Build.standard(2).changed(tail_mm=9.0),
    )
    assert text.index("[trunk]") < text.index("[[level]]") < text.index("[build]")


RATIOS = COMMENTED.replace(
    "widths_mm = [\n    40.0,  # trunk\n    24.0,  # first\n    14.0,  # second\n]",
    "trunk_width_mm = 40  # the tube\nwidth_ratio = 0.5\nfillet_ratio = 0.3 # round",
)


def test_ratios_stay_while_the_design_follows_from_them():
    design = read(RATIOS)
    build = design.build.changed(widths_mm=(40.0, 20.0), fillet_mm=(6.0,))
    text, _ = changed(RATIOS, levels=design.levels[:1], build=build)
    assert "trunk_width_mm = 40  # the tube\nwidth_ratio = 0.5\nfillet_ratio = 0.3 # round" in text
    assert "widths_mm" not in text


def test_ratios_give_way_to_widths_of_their_own():
    design = read(RATIOS)
    text, _ = changed(RATIOS, build=design.build.changed(widths_mm=(40.0, 21.0, 10.0)))
    assert "widths_mm = [40.0, 21.0, 10.0]\n" in text
    assert "width_ratio" not in text
    assert "trunk_width_mm" not in text
    assert "fillet_mm = [6.0, 3.0]" in text
    assert "fillet_ratio" not in text


def test_optional_parts_come_and_go():
    design = read(COMMENTED)
    build = design.build.changed(
        taper=(1.0, 0.9, 0.8),
        pouch=Pouch(shape="rectangle", length_mm=30.0, width_mm=24.0),
        collar=Collar(clamp_diameter_mm=50.0),
        pieces=PieceSettings(most=3),
        pressure_kpa=31.0,
    )
    text, with_parts = changed(
        COMMENTED,
        build=build,
        waivers=(*design.waivers, Waiver(fingerprint="d", reason="e")),
        limits={},
        origin={"run": "r2", "growth": {"body": "centerline"}},
    )
    added = text.index("taper = [1.0, 0.9, 0.8]")
    assert text.index("# jams in gaps") < added < text.index("# Looked at on the bench:")
    back, _ = changed(text, **{name: getattr(design, name) for name in ("build", "waivers")})
    assert "taper" not in back
    assert "collar" not in back
    assert "pieces" not in back
    bare, _ = changed(text, build=with_parts.build.changed(pouch=None), waivers=(), origin={})
    assert "pouch" not in bare
    assert "[[waive]]" not in bare
    assert "[origin]" not in bare


def test_what_was_not_in_the_file_is_added():
    text = '# hand\nschema = "vinefab/design-1"\nname = "a"\ntrunk = { length = 9 } # mm'
    design = read(text)
    result, _ = changed(
        text,
        levels=(Level.of(2, 30.0),),
        build=Build.standard(2).changed(pressure_kpa=5.0, collar=Collar(clamp_diameter_mm=9.0)),
        waivers=(Waiver(fingerprint="d", reason="e"),),
        limits={"VF-C01": {"warning": 1.0}},
        origin={"a": [1, 2]},
    )
    assert edited_text(text, design, "test") == text
    assert result.startswith('# hand\nschema = "vinefab/design-1"\nname = "a"\ntrunk = { length')


def test_layouts_of_other_hands():
    dotted = 'schema = "vinefab/design-1"\nname = "a" # n\ntrunk.length = 9.0 # t\n'
    inline = "level = [{ branches = 2, length = 5 }, { branches = 3, length = 6 }] # l\n"
    tables = "[build.pouch]\n# why\nshape = 'round'\nradius_mm = 12 # r\n"
    text = dotted + inline + tables
    design = read(text)
    result, _ = changed(
        text,
        trunk_length_mm=10.0,
        levels=(design.levels[1], design.levels[0].changed(length_mm=7.0)),
        build=design.build.changed(pouch=Pouch(shape="round", radius_mm=13.0), tail_mm=1.0),
    )
    assert "radius_mm = 13.0 # r" in result
    changed(text, levels=(), build=Build.standard(1))
    changed(
        text, levels=(*design.levels, Level.of(1, 2.0)), build=Build.standard(4).changed(tail_mm=3)
    )


def test_scales_that_are_no_power_of_two_are_off_by_the_last_place_at_most():
    text = COMMENTED.replace("scale_mm_per_unit = 2.0", "scale_mm_per_unit = 25.4")
    design = read(text)
    for length_mm in (30.0, 31.0, 27.3, 254.0):
        result = edited_text(text, design.changed(trunk_length_mm=length_mm), "test")
        assert read(result).trunk_length_mm == pytest.approx(length_mm, rel=4e-16, abs=0.0)
        assert comments(result) == comments(text)
    assert "length = 10.0 " in result


MANY_DOTTED = COMMENTED + "".join(f"more.key_{number} .a = 1\n" for number in range(201))


@pytest.mark.parametrize(
    ("text", "kind", "says"),
    [
        ("schema = ", UnreadableFileError, "is not TOML"),
        ('schema = "vinefab/design-1"\nname = "x"', BadInputError, "trunk is missing"),
        (COMMENTED + f"# {'x' * 66_000}\n", CannotWriteError, "65536 bytes are not changed in"),
        (MANY_DOTTED, CannotWriteError, "200 dotted keys are not changed in place"),
    ],
)
def test_what_cannot_be_changed_is_refused_in_one_line(text, kind, says):
    with pytest.raises(kind, match=says) as refused:
        edited_text(text, read(COMMENTED).changed(name="other"), "mine.toml")
    assert str(refused.value).startswith("mine.toml")
    assert "\n" not in str(refused.value)


numbers = st.floats(0.5, 500.0) | st.integers(1, 500).map(float)
names_of_designs = st.sampled_from(["six", "other-1"])


@st.composite
def levels_of_files(draw) -> Level:
    return Level.of(
        draw(st.integers(1, 4)),
        2.0 * draw(numbers),
        draw(st.floats(0.0, 360.0) | st.integers(0, 360)),
        draw(st.floats(1.0, 300.0) | st.just(100.0)),
    )


@st.composite
def designs(draw) -> Design:
    old = list(read(COMMENTED).levels)
    levels = draw(st.lists(levels_of_files() | st.sampled_from(old), max_size=4))
    ratio = draw(st.sampled_from([0.5, 0.6]))
    widths = Build.standard(len(levels) + 1, 40.0, ratio).widths_mm
    if draw(st.booleans()):
        widths = tuple(draw(numbers) for _ in widths)
    fillets = default_fillets_mm(widths)
    if draw(st.booleans()):
        fillets = tuple(draw(numbers) for _ in fillets)
    pouches = (
        None,
        Pouch(shape="round", radius_mm=16.0),
        Pouch(shape="rectangle", length_mm=3, width_mm=4.5),
    )
    build = Build(
        widths_mm=widths,
        fillet_mm=fillets,
        taper=draw(st.sampled_from([(), (0.5,) * len(widths)])),
        tail_mm=draw(st.sampled_from([250.0, 200.0, 12.5])),
        pouch=draw(st.sampled_from(pouches)),
        collar=draw(st.none() | st.builds(Collar, clamp_diameter_mm=numbers)),
        pieces=draw(st.none() | st.builds(PieceSettings, most=st.integers(1, 9))),
        mounting=draw(st.sampled_from(get_args(Mounting))),
    )
    waivers = st.lists(
        st.builds(Waiver, fingerprint=st.sampled_from(["abc", "d"]), reason=st.just("tested")),
        max_size=3,
    )
    free = st.dictionaries(st.sampled_from(["run", "a b", "c"]), st.integers(-9, 9) | st.booleans())
    return Design(
        name=draw(names_of_designs),
        trunk_length_mm=2.0 * draw(numbers),
        levels=tuple(levels),
        build=build,
        waivers=tuple(draw(waivers)),
        limits=draw(
            st.dictionaries(st.sampled_from(["VF-C01", "VF-B01"]), st.just({"error": 2.5}))
        ),
        origin=draw(st.just({}) | st.fixed_dictionaries({"run": st.just("r1"), "more": free})),
    )


@given(
    start=st.sampled_from([COMMENTED, RATIOS, COMMENTED.replace("\n", "\r\n")]),
    first=designs(),
    second=designs(),
)
@settings(max_examples=40)
def test_any_design_is_read_back_and_no_comment_is_lost(start, first, second):
    once = edited_text(start, first, "test")
    twice = edited_text(once, second, "test")
    assert read(once) == first
    assert read(twice) == second
    assert comments(once) == comments(start)
    assert comments(twice) == comments(start)
    assert edited_text(twice, second, "test") == twice


BRANCHED = """\
# A robot, branch by branch.
schema = "vinefab/design-1"
name = "tree"   # by hand
scale_mm_per_unit = 2.0  # drawn in half size

[trunk]
length = 70.0  # from the base
bends = [[30.0, 25.0]]  # a turn

# Over the gap.
[[branch]]
name = "left"
angle_deg = 62.0   # steep
length = 80.0
bends = [[20.0, 20.0], [50.0, -35.0]]  # around the post
width_mm = 15.6

# To the target.
[[branch]]
name = "right"
of = "trunk"
angle_deg = -40   # deg
length = 50
pouch = false # none here

# Its child.
[[branch]]
name = "far"
of = "right"
length = 40

[build]
tail_mm = 250 # inverted over the base
pouch = { shape = "round", radius_mm = 16.0 }
# the end
"""


def test_one_branch_changes_in_its_place():
    design = read(BRANCHED)
    moved = design.with_branch("left", angle_deg=60.0, bends=((42.0, 20.0), (100.0, -35.0)))
    text, _ = changed(BRANCHED, branches=moved.branches)
    assert new_lines(BRANCHED, text) == [
        "angle_deg = 60.0   # steep",
        "bends = [[21.0, 20.0], [50.0, -35.0]]  # around the post",
    ]
    narrow, _ = changed(BRANCHED, branches=design.with_branch("far", width_mm=8.0).branches)
    assert new_lines(BRANCHED, narrow) == ["width_mm = 8.0"]
    assert narrow.index("# Its child.") < narrow.index("width_mm = 8.0") < narrow.index("[build]")


def test_a_branch_that_goes_leaves_the_comments_of_the_others_in_place():
    design = read(BRANCHED)
    left = tuple(branch for branch in design.branches if branch.name != "left")
    text, _ = changed(BRANCHED, branches=left)
    assert "angle_deg = -40   # deg" in text
    assert "left" not in text
    both, _ = changed(BRANCHED, branches=(*left[1:], *left[:1]))
    assert both.count("[[branch]]") == 2


def test_a_branch_with_a_pouch_of_its_own_is_added_below_the_others():
    design = read(BRANCHED)
    pouch = Pouch(shape="round", radius_mm=20.0)
    new = Branch(name="new", of="far", length_mm=30.0, angle_deg=5.0, pouch=pouch)
    text, _ = changed(BRANCHED, branches=(*design.branches, new), build=Build())
    assert text.index("# Its child.") < text.index('name = "new"') < text.index("[build]")
    assert 'pouch = {shape = "round", radius_mm = 20.0}' in text


def test_levels_become_branches_and_back():
    text = COMMENTED.replace("length   =   45.5     #", "length = 45.5\nangle_deg = 50  #")
    design = read(text)
    free = edited_text(text, design.by_branches, "test")
    assert read(free) == design.by_branches
    assert comments(free) == comments(text)
    assert "[[level]]" not in free
    assert read(edited_text(free, design, "test")) == design


@st.composite
def designs_of_branches(draw) -> Design:
    count = draw(st.integers(1, 5))
    branches = list[Branch]()
    for number in range(count):
        name = draw(st.sampled_from(["left", "right", "far", f"b{number}"]))
        if name in {branch.name for branch in branches}:
            continue
        parents = ["trunk", *(branch.name for branch in branches)]
        length_mm = 2.0 * draw(numbers)
        turns = st.lists(st.floats(-170.0, 170.0).filter(bool), max_size=2)
        bends = [(length_mm * (0.3 + 0.3 * n), turn) for n, turn in enumerate(draw(turns))]
        branches.append(
            Branch(
                name=name,
                of=draw(st.sampled_from(parents)),
                angle_deg=draw(st.integers(-60, 60)) + number / 16.0,
                length_mm=length_mm,
                bends=tuple(bends) or None,
                width_mm=draw(st.none() | st.just(0.01)),
                taper=draw(st.none() | st.just(0.5)),
                pouch=draw(st.sampled_from([None, True, False, Pouch(shape="round", radius_mm=3)])),
            )
        )
    return Design(
        name=draw(names_of_designs),
        trunk_length_mm=2.0 * draw(numbers),
        branches=tuple(branches),
        build=Build(trunk_width_mm=0.01, tail_mm=draw(st.sampled_from([250.0, 12.5]))),
    )


@given(first=designs_of_branches(), second=designs_of_branches() | designs())
@settings(max_examples=25)
def test_any_design_of_branches_is_read_back_and_no_comment_is_lost(first, second):
    once = edited_text(BRANCHED, first, "test")
    twice = edited_text(once, second, "test")
    assert read(once) == first
    assert read(twice) == second
    assert comments(once) == comments(BRANCHED)
    assert comments(twice) == comments(BRANCHED)

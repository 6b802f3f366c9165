"""Records read: results, runs that are followed, and listings."""

import json
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from tests.search.conftest import optimize
from vinefab.core.errors import BadInputError, CannotWriteError, UnreadableFileError
from vinefab.growth.options import GrowthOptions
from vinefab.maps.generators.cave import cave_map
from vinefab.model.design import PieceSettings, Pouch
from vinefab.model.files.run_context import map_fingerprint
from vinefab.search.record.generations import RunIdentity
from vinefab.search.record.result import (
    RECORD_FILE,
    RecordTail,
    RunArchive,
    damage_errors,
    map_from_text,
    map_to_text,
    records_in,
)
from vinefab.search.record.store import RunStore
from vinefab.search.run import Search
from vinefab.search.run_pages import list_runs
from vinefab.search.settings import (
    EvaluationSettings,
    MapSettings,
    PartSettings,
    plain_settings,
    settings_from_plain,
)
from vinefab.search.space import Bounds, BuildSettings


def recorded(folder, settings, maps):
    identity = RunIdentity.of(settings, maps)
    with RunStore.open(folder, identity, maps=maps) as store:
        return Search.of(settings, maps, None).run(store=store)


def test_a_record_gives_the_result_of_its_run(tmp_path, small, maps):
    result = recorded(tmp_path, small, maps)
    archive = RunArchive.read(tmp_path / RECORD_FILE)
    again = archive.result()
    assert again.best == result.best
    assert again.score == result.score
    assert again.stopped == result.stopped == "generations"
    for one, other in zip(again.history, result.history, strict=True):
        np.testing.assert_array_equal(one.x, other.x)
        np.testing.assert_array_equal(one.fitness, other.fitness)
        assert one.seconds == other.seconds
    assert archive.settings == small
    assert [map_fingerprint(m) for m in archive.maps] == [map_fingerprint(m) for m in maps]
    (session,) = archive.sessions
    assert session.total_s > 0.0
    assert session.evaluating_s == pytest.approx(result.times.evaluating_s, rel=0.5)
    summary = archive.summary
    assert summary.evaluations == 30
    assert summary.winner_score == result.score.composite


def test_a_record_without_its_session_is_damaged(tmp_path, small, maps):
    recorded(tmp_path, small, maps)
    with closing(sqlite3.connect(tmp_path / RECORD_FILE)) as connection, connection:
        connection.execute("DELETE FROM session")
    with pytest.raises(UnreadableFileError, match="its session is missing"):
        RunArchive.read(tmp_path / RECORD_FILE).result()


def test_a_record_without_maps_is_damaged(tmp_path, small, maps):
    recorded(tmp_path, small, maps)
    with closing(sqlite3.connect(tmp_path / RECORD_FILE)) as connection, connection:
        connection.execute("DELETE FROM map")
    with pytest.raises(UnreadableFileError, match="holds no training map"):
        RunArchive.read(tmp_path / RECORD_FILE)


@pytest.mark.parametrize("versions", ["7", "{}"])
def test_a_record_without_versions_is_not_resumed(tmp_path, small, maps, versions):
    recorded(tmp_path, small, maps)
    with closing(sqlite3.connect(tmp_path / RECORD_FILE)) as connection, connection:
        connection.execute("UPDATE run SET value = ? WHERE key = 'versions'", (versions,))
    identity = RunIdentity.of(small, maps)
    with pytest.raises(UnreadableFileError, match="is damaged or no record"):
        RunStore.open(tmp_path, identity, maps=maps, resume=True)


def test_a_record_of_infinite_times_is_listed_as_unreadable(tmp_path, small, maps):
    recorded(tmp_path, small, maps)
    with closing(sqlite3.connect(tmp_path / RECORD_FILE)) as connection, connection:
        connection.execute("UPDATE generation SET seconds = 1e308")
        connection.execute(
            "UPDATE session SET seconds = replace(seconds, '0.', '1e999, \"x\": 0.')"
        )
        connection.execute("UPDATE finalist SET fitness = 9e999")
    listing = list_runs([tmp_path])
    assert not listing.rows
    assert len(listing.broken) == 1


def test_all_settings_read_back_the_same(small):
    space = small.space.changed(
        by_level={
            1: {"length_mm": Bounds(low=40, high=120)},
            3: {"branches": Bounds(low=2, high=2)},
        },
    )
    rich = small.changed(
        space=space,
        maps=MapSettings(count=2, files=(Path("a.geojson"), Path("b/c.geojson"))),
        task=PartSettings(name="coverage", parameters={"radius_mm": 40.0, "clip": "none"}),
        growth=GrowthOptions.published(body="inflated", children_of_stuck="deploy"),
        optimizer=PartSettings(name="cmaes", parameters={"spread": 0.3}),
        build=BuildSettings(
            pouch=Pouch(shape="round", radius_mm=12.0), pieces=PieceSettings(most=3)
        ),
        evaluation=EvaluationSettings(joint_weight=0.01),
    )
    assert settings_from_plain(plain_settings(rich)) == rich
    wide = rich.changed(build=BuildSettings(widths_mm=(30.0, 20.0)))
    assert settings_from_plain(json.loads(json.dumps(plain_settings(wide)))) == wide


def test_maps_read_back_to_the_last_bit(maps):
    for world in (*maps, cave_map(3)):
        again = map_from_text(map_to_text(world))
        assert map_fingerprint(again) == map_fingerprint(world)
        assert (again.environment, again.seed) == (world.environment, world.seed)


def test_a_run_that_has_not_ended_has_no_result(tmp_path, small, maps):
    with RunStore.open(tmp_path, RunIdentity.of(small, maps), maps=maps):
        archive = RunArchive.read(tmp_path / RECORD_FILE)  # while open for writing
    assert archive.summary.best_fitness is None
    with pytest.raises(BadInputError, match="has not ended"):
        archive.result()


def test_a_run_is_followed_while_it_is_recorded(tmp_path, small, maps):
    path = tmp_path / RECORD_FILE
    assert RecordTail.read(path) is None
    path.touch()  # as SQLite leaves it until the run has chosen how to write
    assert RecordTail.read(path) is None
    path.unlink()
    seen: list[int] = []

    def follow(progress):
        tail = RecordTail.read(path, len(seen))
        assert tail is not None
        assert not tail.stopped
        seen.extend(generation.number for generation in tail.generations)
        for one in tail.generations:
            np.testing.assert_array_equal(one.x, progress.history[one.number].x)

    with RunStore.open(tmp_path, RunIdentity.of(small, maps), maps=maps) as store:
        result = optimize(small, maps, store=store, progress=follow)
    tail = RecordTail.read(path, len(seen))
    assert tail is not None
    seen += [generation.number for generation in tail.generations]
    assert seen == list(range(len(result.history)))
    assert (tail.stopped, tail.run_id, tail.settings) == ("generations", result.run_id, small)
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(UnreadableFileError):
        RecordTail.read(path)


def test_records_are_found_below_a_folder_and_others_refused(tmp_path, small, maps):
    for name in ("b", "a/deep"):
        RunStore.open(tmp_path / name, RunIdentity.of(small, maps), maps=maps).close()
    found = records_in(tmp_path)
    assert [path.parent.relative_to(tmp_path).as_posix() for path in found] == ["a/deep", "b"]
    with pytest.raises(UnreadableFileError, match="no such folder"):
        records_in(tmp_path / "none")
    with pytest.raises(UnreadableFileError, match="no such file"):
        RunArchive.read(tmp_path / "none" / RECORD_FILE)
    old = sqlite3.connect(found[0])
    old.execute("UPDATE run SET value = 'vinefab/run-store-1' WHERE key = 'schema'")
    old.commit()
    old.close()
    with pytest.raises(UnreadableFileError, match="has schema vinefab/run-store-1; this vinefab"):
        RunArchive.read(found[0])


def test_a_full_disk_is_no_damage_and_walks_have_limits(tmp_path):
    full = sqlite3.OperationalError("disk I/O error")
    full.sqlite_errorcode = sqlite3.SQLITE_IOERR_WRITE
    with pytest.raises(CannotWriteError, match="the disk is full"), damage_errors(tmp_path):
        raise full
    with pytest.raises(UnreadableFileError, match="is damaged"), damage_errors(tmp_path):
        raise sqlite3.DatabaseError("file is not a database")
    for name in "abc":
        (tmp_path / name).mkdir()
    assert records_in(tmp_path, most=4) == []
    with pytest.raises(UnreadableFileError, match="more than 3 folders"):
        records_in(tmp_path, most=3)

"""Run the optimizer, keep its record, and read the record again without the run file.

Run it as ``python examples/read_a_run.py FOLDER``; a second time it only reads.
"""

import sys
from pathlib import Path

import vinefab as vf
from vinefab.search.record.result import RunArchive, records_in


def main(folder: Path) -> None:
    settings = vf.RunSettings(
        name="short_run",
        maps=vf.MapSettings(environment="cave", count=2, seed=1),
        search=vf.SearchSettings(population=10, generations=4, seed=1),
        evaluation=vf.EvaluationSettings(fabricable=False),
    )
    vf.optimize(settings, out=folder, resume=any(folder.glob("*.sqlite")), page=False)
    for path in records_in(folder):
        archive = RunArchive.read(path)
        print(f"{path.name}: {archive.settings.task.name} on {len(archive.maps)} maps")
        for generation in archive.history:
            print(f"  generation {generation.number}: best {generation.fitness.max():.4f}")
        winner = archive.result()
        print(f"  winner: {winner.best.branch_count} branches, run {winner.run_id}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))

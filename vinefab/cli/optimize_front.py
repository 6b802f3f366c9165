"""What ``vinefab optimize`` writes for a run file with several objectives."""

from pathlib import Path

from vinefab.cli.options import Voice
from vinefab.core.atomic import write_bytes, write_text
from vinefab.files.design import design_text
from vinefab.optimize.result import RunResult
from vinefab.optimize.settings import RunSettings
from vinefab.pipeline.front import front_json, front_lines, front_of, front_picture
from vinefab.pipeline.optimize import training_maps
from vinefab.report.figure import png_bytes, svg_bytes


def write_front(result: RunResult, settings: RunSettings, out: Path, voice: Voice) -> None:
    """Write the designs of a front, ``front.json`` and its picture, and say what they are worth."""
    members = front_of(result, settings)
    for member in members:
        path = out / "front" / f"{member.design.name}.toml"
        write_text(path, design_text(member.design), force=voice.force)
    write_text(out / "front.json", front_json(members, result, settings), force=voice.force)
    figure = front_picture(members, result, settings, training_maps(settings)[0])
    write_bytes(out / "front.svg", svg_bytes(figure), force=voice.force)
    write_bytes(out / "front.png", png_bytes(figure), force=voice.force)
    for line in front_lines(members, settings):
        voice.say(line)
    voice.say(f"wrote {out / 'front.json'}, {out / 'front.svg'} and the designs in {out / 'front'}")

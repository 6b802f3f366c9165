from dataclasses import dataclass

from vinefab.studies.paper_charts import forest, svg_bytes


@dataclass(frozen=True)
class Result:
    value: float
    low: float
    high: float

    @property
    def held(self):
        return self.low > 0.0


def test_what_holds_is_filled_what_does_not_is_hollow_and_what_was_not_asked_is_said():
    results = {"one": Result(0.2, 0.1, 0.3), "two": Result(0.1, -0.1, 0.3)}
    figure = forest({"first": results, "second": {"one": results["one"]}}, ["one", "two"], "x")
    first, second = figure.axes
    marks = [line for line in first.lines if line.get_marker() == "o"]
    assert [mark.get_markerfacecolor() == "white" for mark in marks] == [False, True]
    assert [mark.get_xdata()[0] for mark in marks] == [0.2, 0.1]
    spans = [tuple(line.get_xdata()) for line in first.lines if len(line.get_xdata()) == 2]
    assert (0.1, 0.3) in spans
    assert (-0.1, 0.3) in spans
    assert first.get_ylim()[0] > first.get_ylim()[1]  # the first variant stands on top
    assert [text.get_text() for text in second.texts] == ["not tested"]
    assert svg_bytes(figure).startswith(b"<?xml")

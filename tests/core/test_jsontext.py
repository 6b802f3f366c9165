import json
import math

import numpy as np
import pytest

from vinefab.core.hashing import fingerprint
from vinefab.core.plain_text import json_text


def test_schema_comes_first_and_numpy_values_are_plain():
    document = json.loads(json_text("vinefab/x-1", {"a": np.arange(2), "b": np.float64(0.5)}))
    assert list(document) == ["schema", "generator", "a", "b"]
    assert (document["a"], document["b"]) == ([0, 1], 0.5)


def test_nan_is_refused_because_json_cannot_say_it():
    with pytest.raises(ValueError, match="JSON compliant"):
        json_text("vinefab/x-1", {"a": math.nan})


def test_fingerprints_differ_by_any_part():
    prints = {
        fingerprint("a", "b"),
        fingerprint("ab"),
        fingerprint("a", "c"),
        fingerprint("b", "a"),
    }
    assert len(prints) == 4

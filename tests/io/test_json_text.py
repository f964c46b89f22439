import json
from pathlib import Path

import numpy as np

from cascadenorm.io.json_text import json_text


def test_numbers_that_json_lacks_become_text_at_every_depth():
    content = {"a": (1, [np.inf, {"b": -np.inf}]), "c": 0.5, "d": None, "e": np.nan, "f": Path("some") / "place"}
    found = json.loads(json_text(content))
    assert found == {"a": [1, ["inf", {"b": "-inf"}]], "c": 0.5, "d": None, "e": "nan", "f": str(content["f"])}
    assert json.loads(json_text(content, indent=2)) == found

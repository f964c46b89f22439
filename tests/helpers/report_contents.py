"""What reports hold, read back, and the meshes that they are about."""

import base64
import json
import re
import zlib

import numpy as np
from shapes import icosphere, noisy

CLEAN = icosphere(3)
ROUGH = noisy(CLEAN, 0.2)


def unpacked(pack):
    """Undo `packed`: the twin of viewer/src/format.ts."""
    count = int(np.prod(pack["shape"]))
    planes = np.frombuffer(zlib.decompress(base64.b64decode(pack["data"])), np.uint8).reshape(pack["bytes"], count)
    folded = sum(plane.astype(np.int64) << (8 * byte) for byte, plane in enumerate(planes))
    columns = ((folded >> 1) ^ -(folded & 1)).reshape(-1, pack["shape"][0])
    if pack["differences"]:
        columns = np.cumsum(columns, axis=1)
    return columns.T.reshape(pack["shape"])


def scene_of(path):
    found = re.search(r'<script type="application/json" id="scene">(.*?)</script>', path.read_text(), re.S)
    return json.loads(found[1])


def text_of(path):
    """What stands in a report without its scripts and styles."""
    page = re.sub(r"<(script|style)\b.*?</\1>", "", path.read_text(), flags=re.S)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", page))

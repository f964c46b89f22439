"""Paint pins vertices and weights their displacement."""

import io
import json
from urllib.parse import unquote
from zipfile import ZipFile

import numpy as np
from scans import LAPLACIAN, ROUGH

import cascadenorm as cn


def test_paint_is_downloaded_with_the_result(studio):
    codes = np.zeros(len(ROUGH.vertices), np.uint8)
    codes[:10], codes[10:30] = 255, 51
    try:
        studio.done("/api/paint", codes.tobytes())
        status, packed = studio.asked("POST", "/api/download", {"settings": LAPLACIAN, "name": "new.ply"})
        about = json.loads(unquote(studio.headers["x-about"]))
        assert status == 200 and about["name"] == "new.zip"
        assert about["files"] == ["new.ply", "new_fixed.npy", "new_mask.npy"]
        with ZipFile(io.BytesIO(packed)) as archive:
            assert sorted(archive.namelist()) == about["files"]
            fixed, mask = (np.load(io.BytesIO(archive.read(f"new_{name}.npy"))) for name in ("fixed", "mask"))
            (studio.folder / "new.ply").write_bytes(archive.read("new.ply"))
        np.testing.assert_array_equal(np.flatnonzero(fixed), np.arange(10))
        np.testing.assert_array_equal(np.flatnonzero(mask == 0.5), np.arange(10, 30))
        source, out = (cn.read(studio.folder / name).mesh.vertices for name in ("scan.ply", "new.ply"))
        assert np.flatnonzero((source == out).all(axis=1)).tolist() == list(range(10))
    finally:
        (studio.folder / "new.ply").unlink(missing_ok=True)
        studio.done("/api/paint", bytes(len(ROUGH.vertices)))

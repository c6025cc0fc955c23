"""The contact sheet shows every condition."""

from __future__ import annotations

from pathlib import Path

import cv2

from mkdaemon.vision.tags.tagmap import single
from mksim.scene.sheet import contact_sheet


def test_the_sheet_has_25_pictures_with_captions(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "sheet.png"
    contact_sheet(single(0.3048, 48), path)
    sheet = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert sheet.shape == (5 * 264, 5 * 324)
    for row in range(5):
        for column in range(5):
            tile = sheet[264 * row : 264 * (row + 1), 324 * column : 324 * (column + 1)]
            assert tile[:242, 2:-2].std() > 0.5
            assert tile[244:262].min() < 100  # a caption

"""The pictures of README and docs: there, small, drawn by a page's commands, rewritten only where they differ."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bench import gallery

ROOT = Path(__file__).parents[2]
PICTURES = ROOT / "docs" / "pictures"

GALLERY = """
**`small.toml`**

```toml
name = "small"
targets = ["lateral_velocity"]
plant = { vehicle = "car", parameters = "govindarajan_2018", tyre = "linear", sensors = "car_series" }
estimator = [{ name = "EKF", kind = "ekf" }]
drive = [{ name = "slalom", kind = "sine", duration = "6 s", speed = "20 m/s", amplitude = "20 deg" }]
design = [{ name = "level", repeats = 2, factor = [{ parameter = "mass", levels = ["2 t", "2.3 t"] }] }]
```

```sh
harness run small.toml --out results/small
```

![Box plots of the RMSE of lateral velocity per level and estimator](pictures/boxes.png)
![First page of the report](pictures/small-page-1.png)
"""


def test_every_picture_is_there_and_shown_and_small():
    pages = {page: (ROOT / "docs" / page).read_text(encoding="utf-8") for page in gallery.PAGES}
    drawn = {f"{name}.png" for text in pages.values() for _, name in gallery.SHOWN.findall(text)}
    readme = re.findall(r"\]\(docs/pictures/([\w.-]+)\)", (ROOT / "README.md").read_text(encoding="utf-8"))
    sizes = {path.name: path.stat().st_size for path in PICTURES.glob("*.png")}
    assert set(sizes) == drawn
    assert set(readme) <= drawn
    assert len(readme) >= 3
    assert max(sizes.values()) < 140_000
    assert sum(sizes.values()) < 650_000
    for name in sizes:
        with Image.open(PICTURES / name) as picture:
            assert picture.mode == "P", name
            assert 900 <= picture.width <= 1000, name
            assert "transparency" not in picture.info, name


def test_a_page_draws_its_pictures(tmp_path):
    (tmp_path / "gallery.md").write_text(GALLERY, encoding="utf-8")
    command = [sys.executable, "-m", "bench.gallery", str(tmp_path)]
    environment = {"PYTHONPATH": os.pathsep.join(map(str, (ROOT, ROOT / "tests")))}
    done = subprocess.run(command, env=os.environ | environment, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    for name, ratio in (("boxes", (0.2, 0.8)), ("small-page-1", (1.38, 1.43))):
        with Image.open(tmp_path / "pictures" / f"{name}.png") as picture:
            assert picture.width == gallery.WIDTH
            assert ratio[0] < picture.height / picture.width < ratio[1]
            assert len(picture.getcolors()) > 8
            assert picture.convert("L").getpixel((0, 0)) == 255


@pytest.mark.parametrize(("change", "written"), [(0, False), (30, False), (200, True)])
def test_a_picture_is_rewritten_where_it_looks_different(tmp_path, change, written):
    grey = np.full((40, 60), 255, np.uint8)
    grey[10:20, 10:20] = 0
    assert gallery.renewed(tmp_path / "picture.png", Image.fromarray(grey))
    before = (tmp_path / "picture.png").read_bytes()
    grey[30, 40] -= change
    assert gallery.renewed(tmp_path / "picture.png", Image.fromarray(grey)) is written
    assert ((tmp_path / "picture.png").read_bytes() != before) is written


def test_a_figure_that_no_report_has_is_refused(tmp_path):
    with pytest.raises(SystemExit, match="no report has a figure"):
        gallery.report_picture(tmp_path, "words", "boxes")
    with pytest.raises(SystemExit, match="0 reports"):
        gallery.report_picture(tmp_path, "words", "trace-page-1")

"""Draw the figures of the gallery: each study is recorded, diagnosed, and its error drawn stage by stage.

python docs/images/gallery_figures.py [NAME ...] writes gallery-NAME.png beside it.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

EXAMPLES = Path(__file__).parents[2] / "examples"
STUDIES = ("clamp", "motor_heat")


def main() -> None:
    for name in sys.argv[1:] or STUDIES:
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder) / name
            shutil.copytree(EXAMPLES / name, place)
            subprocess.run([sys.executable, "record.py"], cwd=place, check=True)
            subprocess.run(
                [sys.executable, "-m", "vtsdt", "diagnose", "study.toml", "--out", "out"], cwd=place, check=True
            )
            shutil.copy(place / "out" / "falling_error.png", Path(__file__).parent / f"gallery-{name}.png")


if __name__ == "__main__":
    main()

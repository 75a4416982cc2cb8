"""Draw the README's picture: the error of a virtual axis with a hidden effect, stage by stage.

The machine and its recordings are synthetic (`discrepancy.rigs.axis`). Run it with

    python examples/falling_error.py [PICTURE.png]
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from discrepancy import Study
from discrepancy.report.figures import falling_error
from discrepancy.rigs.axis import make_axis

SEED = 7  # that of the README's command
HIDDEN = "stribeck_friction"
PICTURE = Path(__file__).resolve().parent.parent / "docs" / "images" / "falling_error.png"


def main(picture: Path = PICTURE) -> None:
    """Hide an effect in the virtual axis, diagnose its recordings, and draw."""
    with tempfile.TemporaryDirectory() as folder:
        study = Study.from_file(make_axis(Path(folder) / "axis", [HIDDEN], seed=SEED), progress=print)
        conclusion = study.diagnose()
    print(conclusion.sentence)
    print(study.to_frame().to_string())
    falling_error(conclusion).savefig(picture, dpi=110)
    print(f"drawn into {picture}")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))

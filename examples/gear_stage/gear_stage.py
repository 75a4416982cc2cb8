"""A real gear stage at 2000 r/min: which lines does it have that a healthy model lacks, and what turns at their rate?

One pair of gears with 23 and 46 teeth, three accelerometers on one bearing, 4 s at 25.6 kHz.  Module, load and state of
health are not known.  The recording is read from the folder that ``VTSDT_DATA`` names:

    python examples/gear_stage/gear_stage.py out/gear_stage
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from gearbox.signals.recording_analysis import RecordingAnalysis, analyse, families, read_npz

FILE = "gear_stage/gear_2000rpm_25600Hz_4s.npz"
TEETH, SPEED_HZ = (23, 46), 2000.0 / 60.0


def folder() -> Path:
    """Where the recordings are: VTSDT_DATA, else ../shared/data beside the checkout."""
    beside = Path(__file__).resolve().parents[3] / "shared" / "data"
    return Path(os.environ.get("VTSDT_DATA", beside))


def analyses(data: Path) -> dict[str, RecordingAnalysis]:
    """Every channel; the angle of the shafts comes from the channel with the strongest mesh lines."""
    channels = read_npz(data / FILE)
    guide = channels["ch14"]
    return {name: analyse(each, SPEED_HZ, TEETH, reference=guide) for name, each in channels.items()}


def main(out: str = "out/gear_stage") -> None:
    """Print what was found and write a figure for each channel."""
    data = folder()
    if not (data / FILE).is_file():
        sys.exit(f"{data / FILE}: the recording is not here: set VTSDT_DATA to the folder of the recordings")
    target = Path(out)
    target.mkdir(parents=True, exist_ok=True)
    found = analyses(data)
    for name, each in found.items():
        print(each.statement())
        print(each.to_frame().to_string(index=False, float_format="%.3f"))
        each.plot().savefig(target / f"{name}.png", dpi=150)
    print("\nPeaks that neither mesh nor shafts explain, by their distance from the nearest mesh line:")
    print(families(found).to_string(index=False, float_format="%.2f"))
    print(f"\nfigures: {target}")


if __name__ == "__main__":
    main(*sys.argv[1:2])

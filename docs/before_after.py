"""Draw the README's picture from the demo: ``forcecal demo -o first`` makes what it reads.

``python docs/before_after.py first``
"""

from pathlib import Path
import sys

from forcecal_ros.core.streams import Stream
from forcecal_ros.io.bags import read_recording
from forcecal_ros.io.calibration_file import load
from forcecal_ros.observe import replay
from forcecal_ros.report.calibration import forces
from forcecal_ros.report.figures import drawn
from forcecal_ros.report.page import png

SIZE = (8.0, 3.0)
"""Of the picture [in]: its words are still read where a phone makes it 10 cm wide."""

PICTURE = Path(__file__).with_suffix('.png')


def main(demo: Path) -> None:
    """Draw the force along x, in which weight, inertia and contact come one after the other."""
    calibration, recording = load(demo / 'calibration.yaml'), read_recording(demo / 'bag')
    estimate = replay(recording, calibration)
    shown = forces(recording, calibration, Stream(estimate.t, estimate.contact))
    figure = drawn(shown._replace(panels=shown.panels[:1]))
    figure.set_size_inches(*SIZE)
    PICTURE.write_bytes(png(figure))


if __name__ == '__main__':
    main(Path(sys.argv[1]))

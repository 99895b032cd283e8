"""What recordings are compared with: one choice of the source, for the command and for Python."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from forcecal_ros.core.axes import in_axes_of_pose, levelled
from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import UsageError
from forcecal_ros.core.streams import Recording
from forcecal_ros.diagnose.sources.rig import rig_source, ToolSource
from forcecal_ros.diagnose.sources.source import Source
from forcecal_ros.effects.rig import Rig
from forcecal_ros.observe.frames import taken_as_calibrated
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rigid_tool import rigid_tool_of_calibration, rigid_tool_of_rig

RIGID = 'rigid_tool.yaml'
"""Gives the tolerances of a tool if no rig is named."""


def model_of(path: str | Path) -> Any:
    """Return what a file describes: a Calibration, a Rig, or a MuJoCo model (``.xml``)."""
    if str(path).endswith('.xml'):
        from forcecal_ros.sim.mujoco import load_mujoco
        from forcecal_ros.sim.third_party import third_party

        return third_party(str(path), load_mujoco(str(path)))
    from forcecal_ros.io.calibration_file import load

    own = str(path) in ('nominal', 'rig.yaml', RIGID)  # of this package
    rig = own or (Path(path).is_file() and 'wrench_sensor:' in Path(path).read_text())
    return load_rig(path) if rig else load(path)


OPTIONS = ('give --calibration C.yaml (from forcecal calibrate), --rig FILE or --rig nominal, '
           '--simulated SIM_BAG, --mujoco MODEL.xml or --simulator MODULE:FACTORY')
FROM_PYTHON = ("pass against= a calibration, a rig or its file ('nominal': that of this package), "
               'a recording of a simulator, an MJCF file or a simulator')
"""How a command and ``forcecal_ros.diagnose`` take a model."""


def own_rig(recordings: Sequence[Recording], remedy: str = OPTIONS) -> Rig:
    """
    Return the nominal rig of this package, for recordings that the simulated rig made.

    Parameters
    ----------
    remedy : str
        How a model is given.

    Raises
    ------
    UsageError
        The topic of that rig's true contact was not recorded; no model is guessed.
    """
    for one in recordings:
        if one.contact_truth is None:
            raise UsageError(
                f'{one.source or "the recording"}: no model is given to compare it with; {remedy}')
    return load_rig()


def source_of(against: Any, recordings: Sequence[Recording], rig: Rig | None = None,
              accelerometer: str | None = None, name: str = 'the calibration'
              ) -> tuple[Source, list[Recording]]:
    """
    Return what compares recordings with a model, and the recordings as it takes them.

    Parameters
    ----------
    against : sequence of Recording, Calibration, Rig, or simulator
        What a simulator recorded of the same commands, one for each recording; what is known of
        tool and sensors, along the measured motion; a rig, by commands where they were recorded;
        an object with ``parameters`` and ``simulate``.
    rig : Rig, optional
        Gives the tolerances of a tool or simulator.
    accelerometer : str, optional
        Which one is mounted.
    name : str
        Of a calibration, for messages.
    """
    given = [*recordings]
    if isinstance(against, Rig):
        return (rig_source(against, accelerometer) if given[0].target else
                ToolSource(rigid_tool_of_rig(against), None, accelerometer)), given
    rig = rig or load_rig(RIGID)
    if isinstance(against, Calibration):
        level = against.gravity_direction
        given = [in_axes_of_pose(levelled(taken_as_calibrated(one, against, name), level),
                                 against.sensor_rotation) for one in given]
        tool = rigid_tool_of_calibration(against, rig)
        return ToolSource(tool, against, accelerometer), given
    if isinstance(against, Sequence):
        from forcecal_ros.diagnose.sources.pair import PairSource  # loads scipy.stats: 0.7 s

        return PairSource(rig, *against), given
    from forcecal_ros.diagnose.sources.simulator import SimulatorSource
    from forcecal_ros.sim.third_party import third_party, ThirdParty

    found = against if isinstance(against, ThirdParty) else third_party('against', against)
    return SimulatorSource(found, rig), given

"""
Where simulation and recording differ, which effect causes it, how much of the misfit it explains.

One way in for each kind of simulation: :mod:`by_commands` (the rig, told the recorded commands),
:mod:`by_motion` (a rigid tool along the measured motion), :mod:`by_tracked` (both),
:mod:`by_simulated` (a simulator's recording) and :mod:`by_simulator` (a simulator to be run). Each
makes a :class:`~forcecal_ros.diagnose.inputs.dataset.Dataset` of a recording; :mod:`engine` goes
on from there, sub-package after sub-package: :mod:`inputs`, :mod:`model`, :mod:`search`,
:mod:`judge`, :mod:`localise`, :mod:`say`. Beside these, :mod:`plan` says what to record,
:mod:`live` follows a robot while it runs, and :mod:`conformance` tries a simulator.
"""

"""
Where simulation and recording differ, which effect causes it, how much of the misfit it explains.

:mod:`sources` hold what a recording is compared with: each makes a
:class:`~forcecal_ros.diagnose.dataset.Dataset` of it, :mod:`recordings` before that makes it
comparable. :mod:`engine` searches and judges, :mod:`localise` finds the place, :mod:`verdict` and
:mod:`result` state it. :mod:`plan` plans what to record, :mod:`live` follows a running robot.
"""

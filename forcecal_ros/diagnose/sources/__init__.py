"""
What a recording is compared with, a source each: one entry, one document, one report.

:class:`~forcecal_ros.diagnose.sources.source.Source` is the adapter. Its children replay recorded
commands through a rig (:mod:`rig`), carry a tool along the measured motion (:mod:`tool`), take
what another simulator recorded (:mod:`pair`) or run a simulator (:mod:`simulator`).
"""

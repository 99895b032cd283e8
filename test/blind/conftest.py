"""The blind check is not part of what is installed; its tests are where it is."""

from pathlib import Path

BLIND = Path(__file__).resolve().parents[2] / 'benchmark' / 'blind'
collect_ignore_glob = [] if BLIND.is_dir() else ['test_*.py']

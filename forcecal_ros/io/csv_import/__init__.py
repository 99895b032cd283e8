"""Tables of numbers (CSV) with names, units and frames stated beside them, as signals."""

from forcecal_ros.io.csv_import.assemble import assemble, Imported
from forcecal_ros.io.csv_import.specification import load_specification, Specification

__all__ = ['assemble', 'Imported', 'load_specification', 'Specification']

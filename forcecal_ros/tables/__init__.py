"""Tables of numbers (CSV) with names, units and frames stated beside them, as signals."""

from forcecal_ros.tables.assemble import assemble, Imported
from forcecal_ros.tables.specification import load_specification, Specification

__all__ = ['assemble', 'Imported', 'load_specification', 'Specification']

"""One table for every value that a user may write: what it means, its type, unit, range, default.

A row is the annotation of a dataclass field, as in
``mass: Annotated[float, Row('Of the tool', 'kg', above=0.0)] = 1.0``: name, type and default are
the field's own. From the rows are made the reader of a YAML file (:func:`load`), the check
whenever a :class:`Section` is made, the line that says what was expected, the text that is written
(:func:`plain`), and the ROS parameters with their descriptors and files.

Why no library: of those that Ubuntu 24.04 brings, attrs 23.2 with cattrs 23.2 and pydantic 1.10
were tried on the rig. Both take ``true`` and ``'1'`` for a number unless every type gets a hook of
its own, neither knows shapes or units, and their messages name neither the value nor the bound
(``invalid value @ $.tool.com``), or spread over several lines. Code written against pydantic 1
does not run with the pydantic 2 of PyPI. What they would have saved, the walk over the fields, is
what is shortest here.
"""

from forcecal_ros.core.schema.file import load, plain, yaml_value
from forcecal_ros.core.schema.parameter import (
    Parameter,
    parameter_file,
    parameters_of,
    section_of,
)
from forcecal_ros.core.schema.row import (
    Matrix3,
    Mismatch,
    Row,
    Shape,
    shown,
    TEXT,
    Vector3,
    Vector4,
    Vector6,
    Vector7,
)
from forcecal_ros.core.schema.sections import columns, instead, path, read, Section, UNKNOWN

__all__ = ['columns', 'instead', 'load', 'Matrix3', 'Mismatch', 'Parameter', 'parameter_file',
           'parameters_of', 'path', 'plain', 'read', 'Row', 'Section', 'section_of', 'Shape',
           'shown', 'TEXT', 'UNKNOWN', 'Vector3', 'Vector4', 'Vector6', 'Vector7',
           'yaml_value']

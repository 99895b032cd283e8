"""A leg's log as a table or a recording, and the specification that reads it."""

from bag_samples import START_NS
from forcecal_ros.core.streams import Stream
from forcecal_ros.io.bags import write_signals
import numpy as np
import yaml


def write_leg(folder, log, kind, apart=0.0):
    """Write ``leg.yaml`` and a ``csv`` or ``mcap`` whose clocks are apart [s]; return the file."""
    path = {'csv': folder / 'leg.csv', 'mcap': folder / 'leg' / 'leg.mcap'}[kind]
    if kind == 'csv':
        np.savetxt(path, np.column_stack([log.t, log.raw, log.accel]), delimiter=',',
                   header='t,a,b,c,d,e,f,ax,ay,az', comments='', fmt='%.9g')
        read = {'time': {'column': 't', 'unit': 's'},
                'accelerometer': {'columns': ['ax', 'ay', 'az']},
                'sensors': {'leg': {'columns': [*'abcdef'], 'unit': 'counts'}}}
    else:
        write_signals(path.parent, {
            'wrench': Stream(log.t, log.raw, 'leg'),
            'imu': Stream(log.t + apart, np.hstack([log.accel, log.gyro]), 'imu')}, START_NS)
        read = {'accelerometer': {'topic': 'imu/data_raw'},
                'sensors': {'leg': {'topic': 'wrench', 'unit': 'counts'}}}
    (folder / 'leg.yaml').write_text(yaml.safe_dump({
        'format': 'forcecal-insitu/1', 'estimate': 'offset',
        'data_sets': [{'file': str(path.relative_to(folder))}], **read}))
    return path

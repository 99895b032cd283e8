"""A plan as text: a table to read, a document, and parameters that the sequencer runs."""

import math
from typing import Any

from forcecal_ros.diagnose.excitation import ALIKE, Excitation, Shown
from forcecal_ros.diagnose.planning import Planned
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.poses import flatten_poses

HEAD = ('effect', 'at a size of', 'energy', 'shows', 'weakest')


def as_text(excitation: Excitation) -> str:
    """
    Return what a sequence shows as a table, then what it could not tell apart.

    Parameters
    ----------
    excitation : Excitation

    Returns
    -------
    str
    """
    rows = [HEAD, *(_cells(s) for s in excitation.shown)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(HEAD))]
    lines = ['  '.join(cell.rjust(w) if i == 2 else cell.ljust(w)
                       for i, (cell, w) in enumerate(zip(row, widths))).rstrip() for row in rows]
    lines += ['', f'closer than {ALIKE:g} deg to each other, hard to tell apart:']
    lines += [f'  {a.one} / {a.other}: {a.angle_deg:.1f} deg' for a in excitation.aliases] \
        or ['  none']
    return '\n'.join(lines)


def to_document(planned: Planned) -> dict[str, Any]:
    """
    Return a plan as a dictionary.

    Parameters
    ----------
    planned : Planned

    Returns
    -------
    dict
    """
    return {
        'format': 'forcecal-plan/1',
        'duration': float(planned.motion.target.t[-1] - planned.motion.target.t[0]),
        'effects': [{
            'name': s.name, 'size': s.size, 'shows': s.word, 'excited_by': list(s.excited_by),
            'energy': None if math.isnan(s.energy) else s.energy, 'weakest': s.weakest,
            'weakest_energy': None if math.isnan(s.weakest_energy) else s.weakest_energy,
        } for s in planned.excitation.shown],
        'alike': [{'effects': [a.one, a.other], 'angle_deg': a.angle_deg}
                  for a in planned.excitation.aliases]}


def to_parameters(planned: Planned) -> str:
    """
    Return a plan as a parameter file of the sequencer; the table stands in its comments.

    Parameters
    ----------
    planned : Planned

    Returns
    -------
    str
        YAML.
    """
    timing, names = planned.motion.timing, list(planned.motion.poses)
    numbers = flatten_poses(planned.motion.poses)
    rows = [', '.join(str(round(x, 12) + 0.0) for x in numbers[7 * i:7 * i + 7])
            for i in range(len(names))]
    comment = ''.join(f'# {line}'.rstrip() + '\n' for line in
                      as_text(planned.excitation).splitlines())
    text = (f'# Recording for forcecal diagnose.\n{comment}'
            '/**/sequencer:\n  ros__parameters:\n    sequence: diagnose\n    poses:\n'
            f'      names: [{", ".join(names)}]\n'
            '      values: [\n        ' + ',\n        '.join(rows) + ']\n')
    if timing.contacts:
        text += (f'    timing:\n      contact_distance: {timing.contact_distance}\n'
                 f'      contacts: {timing.contacts}\n')
    return text + wider_box(planned.motion.limits)


def wider_box(limits: Limits) -> str:
    """Return the comment with the box that a plan needs, where the default one is too small."""
    x, y, z = limits.workspace_max.tolist()
    if x <= Limits().workspace_max[0]:
        return ''
    return ('    # The way to the wall passes the default box. Look whether the cell is free that '
            'far,\n    # then take the comment signs away.\n    # limits:\n'
            f'    #   workspace_max: [{x:.3f}, {y}, {z}]\n')


def _cells(s: Shown) -> tuple[str, str, str, str, str]:
    if math.isnan(s.energy):
        return s.name, '', '', s.word, ''
    weak = f'{s.weakest}: {s.weakest_energy:.3g}' if s.weakest_energy < s.energy else ''
    return s.name, s.size, f'{s.energy:.3g}', s.word, weak

"""A plan as text: a table to read, a document, and parameters that the sequencer runs."""

import math
from typing import Any

from forcecal_ros.core.quantity import rounded
from forcecal_ros.diagnose.plan.excitation import Alias, CONFOUNDED, Shown, VISIBLE
from forcecal_ros.diagnose.plan.recording import Planned
from forcecal_ros.effects import EFFECTS
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.optimal_design import sequencer_parameters

CONTACT = 'it shows in contact only: add --contact'
HEAD = ('effect', 'at a size of', 'std. errors', 'shows', 'weakest')
"""What an effect's energy is the square of: how many standard errors of its parameter it is."""


def as_text(planned: Planned) -> str:
    """Return what a sequence shows as a table, then what it could not show or tell apart."""
    shown = [s for s in planned.excitation.shown if not planned.asked or s.name in planned.asked]
    rows = [HEAD, *(_cells(s) for s in shown)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(HEAD))]
    lines = ['  '.join(cell.rjust(w) if i == 2 else cell.ljust(w)
                       for i, (cell, w) in enumerate(zip(row, widths))).rstrip() for row in rows]
    lines += ['', f'closer than {CONFOUNDED:g} deg to each other, hard to tell apart:']
    lines += [f'  {a.one} / {a.other}: {a.angle_deg:.1f} deg' for a in aliases(planned)] \
        or ['  none']
    return '\n'.join([*lines, *cannot(planned)])


def aliases(planned: Planned) -> list[Alias]:
    """Return the pairs that are hard to tell apart, of the effects asked for."""
    return [a for a in planned.excitation.aliases
            if not planned.asked or {a.one, a.other} & set(planned.asked)]


def cannot(planned: Planned) -> list[str]:
    """Say which of the effects asked for do not show, and what the limits took away."""
    lines, motion = [], planned.motion
    shown = {s.name: s for s in planned.excitation.shown}
    for name in planned.asked or shown:
        if name not in shown:
            lines.append(f'{name}: a rig with a rigid tool cannot have it')
        elif shown[name].energy < VISIBLE:
            why = (CONTACT if EFFECTS[name].excited_by == ('contact',) and not
                   motion.timing.contacts else 'these limits leave too little motion')
            lines.append(f'{name}: does not show; {why}')
    if motion.timing.amplitude < 1.0:
        lines.append(f'the limits allow {motion.timing.amplitude:.0%} of the usual distances')
    if motion.left_out:
        lines.append(f'outside the limits and left out: {", ".join(motion.left_out)}')
    return lines


def to_document(planned: Planned) -> dict[str, Any]:
    """Return a plan as a dictionary."""
    return {
        'format': 'forcecal-plan/1',
        'duration': float(planned.motion.target.t[-1] - planned.motion.target.t[0]),
        'effects': [{
            'name': s.name, 'size': s.size, 'shows': s.word, 'excited_by': list(s.excited_by),
            'energy': None if math.isnan(s.energy) else s.energy, 'weakest': s.weakest,
            'weakest_energy': None if math.isnan(s.weakest_energy) else s.weakest_energy,
        } for s in planned.excitation.shown if not planned.asked or s.name in planned.asked],
        'alike': [{'effects': [a.one, a.other], 'angle_deg': a.angle_deg}
                  for a in aliases(planned)],
        'cannot': cannot(planned)}


def to_parameters(planned: Planned) -> str:
    """
    Return a plan as a parameter file of the sequencer; the table stands in its comments.

    Returns
    -------
    str
        YAML.
    """
    m = planned.motion
    heading = f'Recording for forcecal diagnose.\n{as_text(planned)}'
    return (sequencer_parameters('diagnose', m.poses, m.timing, m.pace, m.limits, heading)
            + wider_box(m.limits, m.reach))


def wider_box(limits: Limits, reach: float) -> str:
    """Return the comment with the box that contact needs, where that of the limits is smaller."""
    x, y, z = limits.workspace_max.tolist()
    if reach <= x:
        return ''
    return ('    # The way to the wall passes the box. Look whether the cell is free that far,\n'
            '    # then take the comment signs away.\n    # limits:\n'
            f'    #   workspace_max: [{reach:.3f}, {y}, {z}]\n')


def _cells(s: Shown) -> tuple[str, str, str, str, str]:
    if math.isnan(s.energy):
        return s.name, '', '', s.word, ''
    weak = (f'{s.weakest}: {rounded(math.sqrt(s.weakest_energy))}'
            if s.weakest_energy < s.energy else '')
    return s.name, s.size, rounded(math.sqrt(s.energy)), s.word, weak

"""How often the control limits of a fleet alarm by chance, and how soon they notice a shift.

Run ``python benchmark/fleet_limits.py``; it takes about a minute.
"""

from forcecal_ros.report.control_chart import chart, limit
import numpy as np

NIGHTS_BEFORE, NIGHTS_AFTER, ROBOTS = 30, 60, 40
SERIES, LENGTH, RUN_LENGTH = 120, 1000, 200.0
NUMBERS = 40_000.0
"""1000 calibrations between false alarms of a robot, 40 numbers each."""


def false_alarms(rng):
    """Return how many there were, where standard errors differ by ten and are three too small."""
    stds = rng.choice([0.1, 0.3, 1.0], size=(SERIES, LENGTH))
    values = 3.0 * stds * rng.normal(size=stds.shape)
    h = limit(RUN_LENGTH)
    return sum(len(chart(v, s, h).changes) for v, s in zip(values, stds))


def noticed(rng, shift):
    """Return after how many nights a shift was noticed, of each robot where it was."""
    found = []
    for _ in range(ROBOTS):
        values = rng.normal(size=NIGHTS_BEFORE + NIGHTS_AFTER)
        values[NIGHTS_BEFORE:] += shift
        changes = [one for one in chart(values, np.ones(len(values)), limit(NUMBERS)).changes
                   if one.noticed >= NIGHTS_BEFORE]
        found += [changes[0].noticed - NIGHTS_BEFORE + 1] if changes else []
    return found


def main():
    """Measure, and print what was found."""
    rng = np.random.default_rng(5)
    print(f'false alarms: {false_alarms(rng)}, stated {SERIES * LENGTH / RUN_LENGTH:.0f}')
    for shift in (1, 2, 4, 6, 10):
        nights = noticed(rng, shift)
        print(f'shift of {shift} standard deviations: after {np.median(nights):.0f} nights '
              f'(90 %: {np.percentile(nights, 90):.0f}), {ROBOTS - len(nights)} of {ROBOTS} not '
              f'within {NIGHTS_AFTER}')


if __name__ == '__main__':
    main()

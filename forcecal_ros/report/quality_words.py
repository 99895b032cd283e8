"""The quality figures of a calibration as sentences."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from forcecal_ros.report.quantity import rounded, size

DOUBTFUL = 0.01
"""Probability of a chi-square below which its fit is called a poor one, as warnings do."""


def in_words(quality: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """
    Yield each figure as a title and a sentence.

    Parameters
    ----------
    quality : mapping
        Of ``calibration.yaml``; what it does not hold is left out.
    """
    if 'residual_rms' in quality:
        yield 'Left over at rest', (
            f'{_joined(quality["residual_rms"][:3])} N and '
            f'{_joined(quality["residual_rms"][3:])} N m RMS (x, y, z) between the poses and one '
            'rigid tool.')
    if 'condition' in quality:
        yield 'Poses', (f'{_number_of(quality.get("poses", ()))}condition '
                        f'{rounded(float(quality["condition"]))} (1 is best): how well the poses '
                        'tell mass, centre of mass and bias apart.')
    if 'chi_square' in quality:
        yield 'Fit of the poses', _fit(quality['chi_square'])
    if quality.get('rejection', {}).get('poses'):
        yield 'Rejection test', _rejection(quality['rejection'])
    errors = quality.get('errors', {})
    if 'force_eq26' in errors:
        yield 'Expected error', (
            f'{size(abs(float(errors["force_eq26"])), "N", 2)} of contact force at 10 m/s^2, and '
            f'{size(abs(float(errors["acceleration_eq27"])), "m/s^2", 2)} of acceleration, by '
            'what is uncertain here alone; noise comes on top.')
    for key, title in (('pose_delay', 'Delay of the pose'),
                       ('optidrive_delay', 'Delay of the displacement')):
        if key in quality:
            late = float(quality[key])
            yield title, (f'{size(abs(late), "s", 2)} {"behind" if late > 0.0 else "ahead of"} '
                          'the wrench.')
    if quality.get('removed_samples'):
        yield 'Samples left out', str(quality['removed_samples'])
    yield from (('Note', _sentence(note)) for note in quality.get('notes', ()))
    yield from (('Question', _sentence(one)) for one in quality.get('questions', ()))


def _fit(chi_square: Mapping[str, Any]) -> str:
    p = float(chi_square['probability'])
    fits = 'do not fit one rigid tool' if p < DOUBTFUL else 'fit one rigid tool'
    return (f'They {fits}: chi-square {rounded(float(chi_square["value"]))} for '
            f'{chi_square["degrees"]:g} degrees of freedom (probability {rounded(p, 2)}).')


def _rejection(test: Mapping[str, Any]) -> str:
    limit = rounded(float(test['threshold']), 2)
    if test['pose'] is None:
        return f'No pose is off what the others predict by more than chance ({limit} for all).'
    one = test['poses'][int(test['pose']) - 1]
    return (f'Pose {test["pose"]} would be rejected: off by {_joined(one["off"][:3])} N and '
            f'{_joined(one["off"][3:])} N m (x, y, z), {rounded(float(one["mass_eq23"]), 2)} kg '
            f'by Eq. 23 (probability {rounded(float(one["probability"]), 2)}, limit {limit} for '
            'all poses). Measure it again.')


def _number_of(poses: Sequence[Any]) -> str:
    return f'{len(poses)}; ' if poses else ''


def _joined(values: Sequence[float]) -> str:
    return ', '.join(rounded(float(value), 2) for value in values)


def _sentence(words: str) -> str:
    return f'{words[:1].upper()}{words[1:]}.'

"""Calibrations of the simulated leg, and how far they are off in standard errors."""

from forcecal_ros.insitu import calibrate, Chunk, DataSet, Load, Mounting, Options
from insitu_leg import BODY_COM, BODY_MASS, G, GAUGES, PROTOCOL, record, true_matrix
import numpy as np

MANUFACTURER = np.linalg.inv(GAUGES)


def chunks_of(log):
    return Chunk(log.t, log.raw, log.accel, log.gyro)


def data_set(log, load=None, name='one', train=True, window=None):
    stated = None if load is None else Load(load.mass, load.position)
    return DataSet(name, lambda: chunks_of(log), stated, train, window)


def protocol_sets(leg, seed, protocol=PROTOCOL):
    first = round(1000 * seed)
    return [data_set(record(load, leg, first + k), load, f'data set {k + 1}', load.train)
            for k, load in enumerate(protocol)]


def calibrated(leg, seed, options=None, mounting=None, protocol=PROTOCOL):
    return calibrate('leg', protocol_sets(leg, seed, protocol), mounting or Mounting(),
                     options or Options(), MANUFACTURER)


def offset_only(log, **options):
    return calibrate('leg', [data_set(log)], Mounting(), Options(matrix=False, **options))


def validation(result, protocol=PROTOCOL):
    """Yield the result and the truth of every data set that was not trained on."""
    for found, load in zip(result.data_sets, protocol):
        if not load.train:
            yield found, load


def errors(result, protocol=PROTOCOL):
    """Largest errors of added mass [kg], position [m] and relative error of the semi-axes."""
    mass, position, axes = [], [0.0], []
    for found, load in validation(result, protocol):
        mass.append(abs(float(found.added_mass) - load.mass))
        axes.append(np.abs(found.semi_axes.value / ((BODY_MASS + load.mass) * G) - 1).max())
        if load.mass:
            position.append(np.abs(found.position.value - load.position).max())
    return max(mass), max(position), max(axes)


def sigmas(result, leg, protocol=PROTOCOL):
    """Distance of every estimate from its truth in standard errors."""
    pairs = [(result.offset, leg.offset), (result.matrix, true_matrix(leg)),
             (result.mass, BODY_MASS), (result.com, BODY_COM)]
    for found, load in validation(result, protocol):
        pairs += [(found.added_mass, load.mass),
                  (found.semi_axes, np.full(3, (BODY_MASS + load.mass) * G))]
        if load.mass:
            pairs.append((found.position, np.array(load.position)))
    return np.concatenate([np.ravel((estimate.value - truth) / estimate.std)
                           for estimate, truth in pairs])



"""Which added masses determine the matrix, and what is said where they do not."""

from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.insitu.equations import Load, MOVING, require, structural_rank
from insitu_leg import Leg
from insitu_leg import Load as Added
from insitu_runs import calibrated
import pytest

PLACES = ((0.30, 0.10, 0.40), (0.02, -0.14, 0.42), (0.24, -0.12, 0.45), (0.10, 0.20, 0.30),
          (-0.10, 0.05, 0.40))
NONE = Load(0.0)


def equal(count, mass=0.5):
    return [Load(mass, place) for place in PLACES[:count]]


@pytest.mark.parametrize('loads, rank', [
    (equal(3), 36), (equal(4), 36), (equal(5), 36),
    ([Load(mass, PLACES[0]) for mass in (0.3, 0.5, 0.9)], 33),
    ([NONE, *equal(2)], 40),
    ([*equal(2), Load(0.8, PLACES[2])], 40),
    ([NONE, Load(0.3, PLACES[0]), Load(0.6, PLACES[0])], 33),
    ([NONE, Load(0.5, PLACES[0])], 33),
    ([NONE], 18),
])
def test_rank_of_the_forty_unknowns(loads, rank):
    report = structural_rank(loads)
    assert (report.rank, report.unknowns) == (rank, 40)
    assert bool(report.undetermined) == (rank < 40)


@pytest.mark.parametrize('loads, words', [
    (equal(3), ('rank 36 of 40', 'mass of the body', 'no added mass')),
    ([Load(mass, PLACES[0]) for mass in (0.3, 0.5, 0.9)],
     ('rank 33 of 40', 'centre of mass of the body', 'another position')),
    ([NONE, Load(0.5, PLACES[0])], ('rank 33 of 40', 'another position')),
    ([NONE], ('rank 18 of 40', 'another mass', 'another position')),
])
def test_a_short_rank_is_an_error_that_says_what_to_add(loads, words):
    with pytest.raises(UnobservableError) as error:
        require(loads)
    assert all(word in str(error.value) for word in words)


@pytest.mark.parametrize('loads', [equal(3), [NONE], [NONE, Load(0.5, PLACES[0])]])
def test_what_the_error_says_to_add_is_enough(loads):
    with pytest.raises(UnobservableError) as error:
        require(loads)
    advice = str(error.value).split('; add ')[1]
    added = []
    if 'no added mass' in advice:
        added.append(NONE)
    if 'another mass' in advice:
        added.append(Load(1.0, PLACES[0]))
    if 'another position' in advice:
        added.append(Load(0.5, (0.5, -0.3, 0.1)))
    assert structural_rank([*loads, *added]).rank == 40


def test_motion_has_fifty_two_unknowns_and_needs_fewer_loads():
    assert structural_rank([NONE, Load(0.5, PLACES[0])], MOVING).rank == 52
    assert structural_rank([NONE], MOVING).rank < 52


def test_places_a_tenth_of_a_millimetre_apart_are_refused_on_the_data():
    near = (Added(0.0), Added(0.51, (0.2, 0.0, 0.4)), Added(0.51, (0.2, 0.0001, 0.4)),
            Added(0.51, (0.3, 0.1, 0.4), train=False))
    with pytest.raises(UnobservableError, match=r'rank \d+ of 40 beyond noise'):
        calibrated(Leg(duration=20.0), 1, protocol=near)


def test_equal_masses_are_refused_before_any_data_is_read():
    loads = tuple(Added(0.51, place) for place in PLACES[:3])
    with pytest.raises(UnobservableError, match='rank 36 of 40'):
        calibrated(Leg(duration=1.0), 1, protocol=loads)

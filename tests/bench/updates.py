"""Updates of a model by the simulator itself: ``python -m pytest tests/bench/updates.py``.

The tests of updates take resonances from describing functions, which spares them minutes of harmonic balance each. Here
the same cases are held to the same bounds with the simulator in that place.
"""

import pytest

from tests.validation import test_joint_update as cases


def test_joint_parameters_from_a_closed_form_map_with_noise():
    cases.test_joint_parameters_from_a_closed_form_map_with_noise(None)


@pytest.mark.parametrize("chi", [0.4, 0.0])
def test_low_levels_of_one_normal_force_are_not_taken_for_knowledge_of_the_joint(chi):
    cases.test_low_levels_of_one_normal_force_are_not_taken_for_knowledge_of_the_joint(None, chi)


@pytest.mark.parametrize(("number", "determined"), [(1, True), (2, False)])
def test_the_law_of_a_model_is_not_taken_for_that_of_the_joint(number, determined):
    cases.test_the_law_of_a_model_is_not_taken_for_that_of_the_joint(None, number, determined)


def test_a_point_whose_resonance_the_band_cuts_off():
    cases.check_cut((96.0, 109.0))

"""Optimal tracking: meshes over breaks, the LQ optimum, the tube, exact replays, the comparison."""

import numpy as np
import pytest

from wormopt.gaits.construct import fast_gait
from wormopt.optimal.collocation import Collocation
from wormopt.optimal.mesh import Mesh
from wormopt.tracking.loop import with_reference
from wormopt.tracking.reference import follow
from wormopt.worms.chain import chain

# -- meshes over breaks ----------------------------------------------------------------------------


def test_no_arc_of_a_mesh_over_breaks_crosses_one():
    mesh = Mesh.over([0.0, 0.1, 1.0, 3.0], 0.25, Collocation(2), input_degree=1)
    edges = 3.0 * np.cumsum([0.0, *(mesh.shares or ())])
    assert mesh.phases == 1
    assert mesh.input_degree == 1
    assert np.diff(edges).max() <= 0.25 * (1 + 1e-12)
    for time in (0.1, 1.0, 3.0):
        assert np.abs(edges - time).min() < 1e-14
    # 0.1 needs one arc, 0.9 four, 2.0 eight
    assert mesh.total == 1 + 4 + 8


@pytest.mark.parametrize("breaks", [[0.0], [0.0, 0.0, 1.0], [0.0, 2.0, 1.0]])
def test_a_mesh_refuses_breaks_that_do_not_ascend(breaks: list[float]):
    with pytest.raises(ValueError, match="breaks must ascend"):
        Mesh.over(breaks, 0.1, Collocation(2))


def test_breaks_of_a_model_are_those_of_all_its_schedules():
    plant = chain(2, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0)
    model = with_reference(plant, follow(fast_gait(1.0), plant.t, shift=0.1))
    expected = [0.0, *(k / 3 - 0.1 for k in range(1, 7)), 2.0]
    assert model.breaks(2.0) == pytest.approx(expected, abs=1e-12)
    assert len(model.breaks(2.0)) == 8
    # an end that is a break stands once
    whole = with_reference(plant, follow(fast_gait(1.0), plant.t))
    assert len(whole.breaks(10.0)) == 31

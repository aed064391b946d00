import numpy as np
import pytest

from sgbd.sources.synthetic.furniture import WALL_FURNITURE, chair, floor_thing, wall_decoration


@pytest.mark.parametrize("make", [*dict.fromkeys(WALL_FURNITURE), floor_thing, lambda rng: chair(rng, 0.75)])
@pytest.mark.parametrize("seed", range(3))
def test_furniture_stands_on_the_floor_within_its_measures(make, seed: int) -> None:
    thing = make(np.random.default_rng(seed))
    assert thing.parts
    vertices = np.concatenate([part.mesh.vertices for part in thing.parts])
    assert abs(vertices[:, 2].min()) < 0.06
    assert 0.1 < vertices[:, 2].max() < 2.6
    # Leaves of a plant, handles and cushions may extend slightly beyond the footprint.
    if all(part.name != "leaves" for part in thing.parts):
        assert np.abs(vertices[:, 0]).max() <= thing.width / 2 + 0.1
        assert np.abs(vertices[:, 1]).max() <= thing.depth / 2 + 0.1
    assert all(part.mesh.is_watertight for part in thing.parts)


@pytest.mark.parametrize("seed", range(8))
def test_what_hangs_on_a_wall_lies_before_it(seed: int) -> None:
    vertices = np.concatenate([part.mesh.vertices for part in wall_decoration(np.random.default_rng(seed))])
    assert vertices[:, 1].max() < 1e-6
    assert vertices[:, 1].min() > -0.25

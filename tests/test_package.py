import pkgutil
import re
import subprocess
import sys

import pytest

import sgbd


@pytest.mark.parametrize("name", sgbd.__all__)
def test_the_public_names_exist(name: str) -> None:
    assert getattr(sgbd, name)


def test_the_map_of_the_package_has_every_module_once() -> None:
    assert sgbd.__doc__ is not None
    named = re.findall(r"`(\w+)`", sgbd.__doc__.replace("``", ""))
    assert sorted(named) == sorted(module.name for module in pkgutil.iter_modules(sgbd.__path__))


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Segmentor'"):
        sgbd.Segmentor  # noqa: B018


def _imported_by(code: str) -> set[str]:
    """Return the modules loaded after running code in a fresh process."""
    report = "; import sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code + report], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.split())


def test_importing_the_package_does_not_wait_for_pytorch() -> None:
    assert "torch" not in _imported_by("import sgbd, sgbd.sources")


def test_preparing_graphs_needs_neither_pytorch_nor_pyg() -> None:
    code = (
        "import numpy as np; import sgbd.preparation; from sgbd.frame import Frame; "
        "from sgbd.graph import GraphBuilder; "
        "from sgbd.superpixels import FastSlic; frame = Frame(np.zeros((32, 40, 3), np.uint8), np.ones((32, 40)), "
        "None, np.zeros((32, 40), np.int32)); GraphBuilder().arrays(frame, FastSlic(8)(frame))"
    )
    assert _imported_by(code) & {"torch", "torch_geometric", "pandas", "matplotlib", "networkx"} == set()


def test_segmenting_waits_for_nothing_that_it_does_not_use() -> None:
    code = (
        "import numpy as np; from sgbd import Segmenter; from sgbd.checkpoint import Checkpoint; "
        "from sgbd.models import GatedGCN, ObjectnessHead; from sgbd.recipe import describe; "
        "from sgbd.superpixels import FastSlic; from sgbd.graph import GraphBuilder; "
        "from sgbd.partition import GreedyMulticut; from sgbd.segmentation import ObjectRule; "
        "parts = dict(superpixels=FastSlic(8), graph=GraphBuilder()); "
        "parts |= dict(partition=GreedyMulticut(), objects=ObjectRule()); "
        "recipe = {key: describe(part) for key, part in parts.items()}; "
        "recipe['features'] = dict(node=['rgb'], edge=['border']); "
        "segmenter = Segmenter(Checkpoint(GatedGCN(3, 1), ObjectnessHead(3), recipe)); "
        "segmenter.segment(np.zeros((32, 40, 3), np.uint8), np.ones((32, 40)))"
    )
    heavy = {"torch_geometric", "pandas", "matplotlib", "networkx", "hydra", "skimage", "sklearn", "scipy.sparse"}
    heavy |= {"scipy.optimize", "scipy.ndimage", "sgbd.metrics", "sgbd.training"}
    assert _imported_by(code) & heavy == set()

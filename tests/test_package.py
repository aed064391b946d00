import subprocess
import sys

import pytest

import sgbd


@pytest.mark.parametrize("name", sgbd.__all__)
def test_the_public_names_exist(name: str) -> None:
    assert getattr(sgbd, name)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Segmentor'"):
        sgbd.Segmentor  # noqa: B018


def test_importing_the_package_does_not_wait_for_pytorch() -> None:
    code = "import sys, sgbd, sgbd.sources; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

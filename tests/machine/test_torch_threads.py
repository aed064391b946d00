import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
import torch

from sgbd.machine.torch_threads import torch_threads


def test_threads_are_given_back() -> None:
    before = torch.get_num_threads()
    with torch_threads(before + 2):
        assert torch.get_num_threads() == before + 2
        with torch_threads(before + 1):
            assert torch.get_num_threads() == before + 1
        assert torch.get_num_threads() == before + 2
    assert torch.get_num_threads() == before
    with pytest.raises(KeyError), torch_threads(before + 1):
        raise KeyError
    assert torch.get_num_threads() == before


def test_threads_that_start_meanwhile_do_not_keep_the_number_of_others() -> None:
    before = torch.get_num_threads()
    first_has_left = threading.Event()

    def second() -> int:
        with torch_threads(before + 2):
            both_are_inside.set()
            first_has_left.wait(60)
        return torch.get_num_threads()

    with ThreadPoolExecutor(1) as new_thread:
        both_are_inside = threading.Event()
        with torch_threads(before + 2):
            left_last = new_thread.submit(second)
            assert both_are_inside.wait(60)
        first_has_left.set()
        assert left_last.result() == before
    with ThreadPoolExecutor(1) as later_thread:
        assert later_thread.submit(torch.get_num_threads).result() == before
    assert torch.get_num_threads() == before

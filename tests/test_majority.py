import numpy as np

from sgbd.majority import majority_instance


def test_most_pixels_then_the_smaller_id_then_unknown() -> None:
    superpixel = np.array([0, 0, 1, 1, 3])
    instance = np.array([2, 5, 4, 3, 0])
    count = np.array([3, 7, 6, 6, 1])
    assert majority_instance(superpixel, instance, count, 4).tolist() == [5, 3, -1, 0]


def test_the_order_of_the_overlaps_does_not_matter() -> None:
    superpixel, instance, count = np.array([1, 0, 1, 0]), np.array([3, 5, 4, 2]), np.array([6, 7, 6, 3])
    assert majority_instance(superpixel, instance, count, 2).tolist() == [5, 3]

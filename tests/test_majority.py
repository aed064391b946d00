import numpy as np

from sgbd.majority import labeled_instance, majority_instance


def test_most_pixels_then_the_smaller_id_then_unknown() -> None:
    superpixel = np.array([0, 0, 1, 1, 3])
    instance = np.array([2, 5, 4, 3, 0])
    count = np.array([3, 7, 6, 6, 1])
    assert majority_instance(superpixel, instance, count, 4).tolist() == [5, 3, -1, 0]


def test_the_order_of_the_overlaps_does_not_matter() -> None:
    superpixel, instance, count = np.array([1, 0, 1, 0]), np.array([3, 5, 4, 2]), np.array([6, 7, 6, 3])
    assert majority_instance(superpixel, instance, count, 2).tolist() == [5, 3]


def test_a_superpixel_most_of_which_is_ignored_has_no_label() -> None:
    # Superpixels of 10 pixels: 4 known, half known, all known in two pieces, none known.
    superpixel = np.array([0, 1, 2, 2])
    instance = np.array([2, 2, 3, 4])
    count = np.array([4, 5, 4, 6])
    assert labeled_instance(superpixel, instance, count, np.full(4, 10)).tolist() == [-1, 2, 4, -1]
    assert majority_instance(superpixel, instance, count, 4).tolist() == [2, 2, 4, -1], "the oracle takes what is known"

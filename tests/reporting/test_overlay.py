import numpy as np

from sgbd.reporting.overlay import IGNORE_COLOR, SUPPORT_COLOR, instance_colors, overlay


def test_colours_are_stable_and_apart() -> None:
    few, many = instance_colors(np.array([4, 1])), instance_colors(np.arange(30))
    assert (few == many[[4, 1]]).all()
    distance = np.linalg.norm(many[:, None] - many[None], axis=2) + np.eye(30)
    assert distance.min() > 0.05
    assert instance_colors(np.arange(0)).shape == (0, 3)


def test_a_prediction_is_painted_from_one_on() -> None:
    rgb = np.full((5, 7, 3), 100, np.uint8)
    instances = np.zeros((5, 7), np.int32)
    instances[1:4, 2:6] = 1
    picture = overlay(rgb, instances, opacity=1.0)
    inner = (instance_colors(np.arange(1))[0] * 255).round().astype(np.uint8)
    assert picture[2, 3].tolist() == inner.tolist()
    assert picture[0, 0].tolist() == [100, 100, 100]
    # The outline is white.
    assert picture[1, 2].tolist() == [255, 255, 255]


def test_a_truth_shows_support_and_ignored_pixels() -> None:
    rgb = np.zeros((3, 9, 3), np.uint8)
    instances = np.repeat(np.array([[-1, -1, -1, 1, 1, 1, 2, 2, 2]], np.int32), 3, axis=0)
    picture = overlay(rgb, instances, first=2, opacity=1.0)
    assert picture[1, 0].tolist() == [round(value * 255) for value in IGNORE_COLOR]
    assert picture[1, 3].tolist() == [round(value * 255 / 2) for value in SUPPORT_COLOR]
    assert picture[1, 8].tolist() == (instance_colors(np.arange(1))[0] * 255).round().astype(int).tolist()


def test_every_pixel_inside_an_outline_is_its_own_blend() -> None:
    rng = np.random.default_rng(0)
    rgb = rng.integers(0, 256, (12, 40, 3)).astype(np.uint8)
    instances = np.kron(np.array([[-1, 0, 1, 3, 9]], np.int32), np.ones((12, 8), np.int32))
    picture = overlay(rgb, instances, first=2, opacity=0.4)
    palette = instance_colors(np.arange(8))
    colors = {-1: IGNORE_COLOR, 1: SUPPORT_COLOR, 3: palette[1], 9: palette[7]}
    opacities = {-1: 0.4, 0: 0.0, 1: 0.2, 3: 0.4, 9: 0.4}
    for row, column in np.ndindex(12, 40):
        number = int(instances[row, column])
        if column % 8 in (0, 7):
            continue  # beside a border
        opacity = opacities[number]
        color = np.array(colors.get(number, (0.0, 0.0, 0.0)))
        blend = rgb[row, column] / 255 * (1 - opacity) + color * opacity
        assert picture[row, column].tolist() == (blend * 255).round().tolist()


def test_large_ids_have_a_color_too() -> None:
    instances = np.repeat(np.array([[0, 0, 0, 2**31 - 1, 2**31 - 1, 2**31 - 1]], np.int32), 3, axis=0)
    picture = overlay(np.zeros((3, 6, 3), np.uint8), instances, first=2, opacity=1.0)
    assert picture[1, 0].tolist() == [0, 0, 0]
    assert picture[1, 5].max() > 100

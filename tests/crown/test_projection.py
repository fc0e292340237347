import numpy as np
import pytest
from usdfoliage.crown.projection import make_exemplar, project_photo
from usdfoliage.geometry.cubemap import FACES, face_directions

from tests.support.crown_shapes import disc_mask


def gradient_photo(size_px: int):
    """Red grows to the right, green downwards."""
    across = (np.arange(size_px) + 0.5) / size_px
    red, green = np.meshgrid(across, across)
    return np.stack([red, green, np.zeros_like(red)], axis=-1).astype(np.float32)


@pytest.mark.parametrize("texel_px", [0.7, 1.0, 2.5])
def test_every_texel_of_a_ball_shows_the_pixel_before_it(texel_px):
    photo, mask = gradient_photo(300), disc_mask(110, center_px=(140, 160))
    exemplar = make_exemplar(photo, mask, texel_px)

    color, weight = project_photo(exemplar, np.full((6, 65, 65), 100.0), np.array([140.0, 160.0]))

    directions = face_directions(65)
    assert weight == pytest.approx(np.maximum(directions[..., 2], 0), abs=0.03)
    seen = weight > 0.1
    pixel = np.array([140, 160]) + 100 * directions[..., :2] * [1, -1]
    assert color[seen][:, :2] == pytest.approx(pixel[seen] / 300, abs=0.006)


def test_the_front_face_is_mirrored_as_openexr_wants_it():
    exemplar = make_exemplar(gradient_photo(300), disc_mask(110), 1.0)
    color, _ = project_photo(exemplar, np.full((6, 33, 33), 100.0), np.array([150.0, 150.0]))

    front = color[FACES.index("+Z")]
    assert front[16, 0, 0] > front[16, -1, 0]  # x runs to the left
    assert front[0, 16, 1] < front[-1, 16, 1]  # y runs up


def test_no_sky_comes_in_at_the_silhouette():
    photo, mask = np.zeros((200, 200, 3), np.float32), disc_mask(80, size_px=200)
    photo[..., 2] = 1.0  # sky
    inside = disc_mask(79, size_px=200)
    photo[inside] = [0.1, 0.4, 0.05]

    exemplar = make_exemplar(photo, mask, 1.5)
    color, weight = project_photo(exemplar, np.full((6, 65, 65), 80.0), np.array([100.0, 100.0]))

    assert color[weight > 0][:, 2].max() < 0.06
    assert exemplar.color[exemplar.mask][:, 2].max() < 0.06


def test_a_crown_that_fills_the_picture_is_kept_within_it():
    exemplar = make_exemplar(gradient_photo(64), np.ones((64, 64), bool), 2.0)

    assert exemplar.color.shape == (32, 32, 3)
    assert exemplar.corner_px == pytest.approx([0, 0])
    assert np.isfinite(exemplar.color).all()

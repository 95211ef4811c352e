"""Captures: where the mask comes from, and what is handed on from the file."""

from pathlib import Path

import numpy as np
import pytest
from bad_input import NAN, SPHERE, gets_one_clear_sentence, loop, with_pixel
from numpy.typing import ArrayLike
from synthetic import Sphere, write_file

from mpsnet_core import Camera, Capture, angular_error, estimate_normals, published_rig, read_capture, write_image
from mpsnet_core.errors import FileError, GeometryError
from mpsnet_core.io import image

STRIPES = np.float32([[0.5, 1.0, 0.7, 0.9]] * 4)


@pytest.fixture
def with_alpha(tmp_path: Path, sphere: Sphere) -> Path:
    """The sphere rendered as Blender does: premultiplied, alpha one on the object."""
    return write_file(tmp_path / "photo.exr", np.dstack([sphere.image, sphere.mask]), "float")


def test_alpha_is_the_mask_unless_set_otherwise(with_alpha: Path, sphere: Sphere) -> None:
    capture = read_capture(with_alpha, sphere.rig)
    np.testing.assert_array_equal(capture.mask, sphere.mask)
    np.testing.assert_allclose(capture.image[sphere.mask], sphere.image[sphere.mask], rtol=1e-6)
    np.testing.assert_array_equal(read_capture(with_alpha, sphere.rig, mask="alpha").mask, sphere.mask)
    whole = read_capture(with_alpha, sphere.rig, mask="none").mask
    assert whole.all() and whole.strides == (0, 0)  # takes no memory


def test_a_mask_of_shares_counts_from_a_half_as_alpha_does() -> None:
    shares = np.array([[0.2, 0.5, 0.51, 1.0]])
    capture = Capture(np.full((1, 4, 3), 0.5), shares, published_rig())  # type: ignore[arg-type]
    np.testing.assert_array_equal(capture.mask, [[False, False, True, True]])


def test_without_alpha_the_whole_photo_is_taken_and_that_is_said(tmp_path: Path, sphere, caplog) -> None:
    photo = write_file(tmp_path / "photo.exr", sphere.image[20:44, 20:44], "float")
    assert read_capture(photo, sphere.rig).mask.all()
    assert "the whole photo is assumed to be the object" in caplog.text


@pytest.mark.parametrize("model", ["lambertian", "multiscale"])
def test_a_large_photo_is_held_in_half_the_memory(tmp_path, sphere, monkeypatch, model: str) -> None:
    mask = write_file(tmp_path / "mask.png", sphere.mask, "uint8")
    photo = write_file(tmp_path / "photo.png", sphere.image, "uint16")
    captures, normals = [], []
    for pixels in (image.HALF_ABOVE, 0):
        monkeypatch.setattr(image, "HALF_ABOVE", pixels)
        captures.append(read_capture(photo, sphere.rig, mask=mask, encoding="linear"))
        normals.append(estimate_normals(captures[-1], model))
    assert captures[1].image.nbytes * 2 == captures[0].image.nbytes
    assert angular_error(normals[1].vectors, normals[0].vectors)[sphere.mask].max() < 0.2


def test_an_error_keeps_its_kind_where_the_photo_is_named(tmp_path: Path, photo_file: Path, sphere: Sphere) -> None:
    small = write_file(tmp_path / "mask.png", np.ones((8, 8)), "uint8")
    words = rf"{photo_file.name}: the mask is 8 x 8 but the photo is .*; they must be the same size"
    with pytest.raises(GeometryError, match=words):
        read_capture(photo_file, sphere.rig, mask=small)
    with pytest.raises(FileError, match=rf"{photo_file.name}: mask .* does not exist"):
        read_capture(photo_file, sphere.rig, mask=tmp_path / "missing.png")


@pytest.mark.parametrize(("kind", "clip"), [("uint8", 1.0), ("float", np.inf)])
def test_only_integer_files_saturate(tmp_path: Path, sphere: Sphere, kind: str, clip: float) -> None:
    photo = write_file(tmp_path / "photo.tif", sphere.image, kind)
    assert read_capture(photo, sphere.rig).clip == clip


@pytest.mark.parametrize(
    ("pixels", "words"),
    [
        ([0.5, 0.5, 0.5], "it looks like a photo under white light"),
        ([1.0, 0.5, 0.7], "100% of the object's pixels are saturated"),
        ([0.5, 0.6, 0.0], "the blue channel is black: was its light on? [black-channel]"),
        ([0.2, 0.5, 0.6], "one channel is 3.0 times as bright"),
        (np.dstack([STRIPES, STRIPES, STRIPES.T]) / 2, "the red and the green channel show nearly the same light"),
        ([0.5, 0.6, 0.7], None),
    ],
)
def test_a_photo_that_gives_hardly_right_normals_is_reported_of(tmp_path, caplog, pixels: ArrayLike, words: str | None):
    write_image(tmp_path / "photo.png", np.broadcast_to(pixels, (4, 4, 3)))
    with caplog.at_level("INFO", "mpsnet_core"):
        read_capture(tmp_path / "photo.png", published_rig(), mask="none", encoding="linear")
    told = [record.getMessage() for record in caplog.records]
    assert any(words in line for line in told) if words else not told


def test_a_coloured_photo_misleads_no_model_where_a_white_one_is_beside_it(tmp_path, caplog) -> None:
    for name, pixels in (("photo", [0.2, 0.5, 0.6]), ("white", [0.4, 0.4, 0.4])):
        write_image(tmp_path / f"{name}.png", np.broadcast_to(pixels, (4, 4, 3)))
    with caplog.at_level("INFO", "mpsnet_core"):
        white = tmp_path / "white.png"
        read_capture(tmp_path / "photo.png", published_rig(), mask="none", encoding="linear", white=white)
    assert "as bright" not in caplog.text


test_a_bad_capture_gets_one_clear_sentence = gets_one_clear_sentence(
    [
        ("a link to itself", lambda b: b.estimate(mask=loop(b / "m.png")), "mask …m.png does not exist"),
        (lambda b: b.estimate(b.photo(pixels=with_pixel(3e38))), "photo.exr: the photo holds values that are not"),
        (lambda b: read_capture(b.photo(pixels=with_pixel(NAN)), published_rig(), mask="none"), "not finite inside"),
        (lambda b: read_capture(b.photo(), SPHERE.rig, mask=b.mask(values=0 * SPHERE.mask)), "mask is empty"),
        (
            "empty alpha",
            lambda b: read_capture(b.photo(pixels=np.dstack([SPHERE.image, 0 * SPHERE.mask])), SPHERE.rig),
            "photo.exr…mask is empty",
        ),
        (lambda b: b.estimate(mask=f"background:{b.photo('b.exr', SPHERE.image[:8])}"), "the background is 16 x 8"),
        ("alpha where there is none", lambda b: read_capture(b.photo(), SPHERE.rig, mask="alpha"), "no alpha channel"),
        *(
            (
                f"threshold {text!r}",
                lambda b, text=text: read_capture(b.photo(), SPHERE.rig, mask=f"threshold:{text}"),
                f"photo.exr…from 0 up to 1, not '{text}'; 0.05",
            )
            for text in ("low", "", "1.5", "nan")
        ),
        ("black", lambda b: read_capture(b.photo(pixels=0 * SPHERE.image), SPHERE.rig), "black inside the mask"),
        ("grey image", lambda b: SPHERE.capture(image=SPHERE.image[..., 0]), "three channels per pixel…(16, 16)"),
        (lambda b: SPHERE.capture(camera=Camera("orthographic", 20, 10, (8, 8))), "camera is 20 x 10 but the photo is"),
    ]
)

"""Pyramids, networks that run on one scale after another: against loops in NumPy, and on pictures that are known."""

from pathlib import Path

import numpy as np
import onnxruntime
import pytest
from networks import hands_on, sees_all
from synthetic import CROSSTALK, degrees_between

from mpsnet_core import Capture, estimate_normals
from mpsnet_core.errors import Cancelled
from mpsnet_core.estimate import dense
from mpsnet_core.estimate.onnx_model import OnnxModel
from mpsnet_core.estimate.white_photo import normalise_by_white_photo
from mpsnet_core.scene.rig import LightRig, direction_from_angles

pytestmark = pytest.mark.accuracy

RIG = LightRig(direction_from_angles([25.0, 35.0, 45.0], [75.0, 210.0, 320.0]), np.array(CROSSTALK))


@pytest.fixture(scope="module")
def ragged() -> Capture:
    """Odd in size, away from the picture's corner, with a gap wider than a tile, and a mask with holes.

    The box is 261 x 77 pixels, and so 131 x 39 and 66 x 20 on the two scales before.
    """
    random = np.random.default_rng(5)
    y, x = np.mgrid[:270, :91]
    mask = ((x - 45) / 39) ** 2 + ((y - 134) / 131) ** 2 < 1
    mask &= (random.random(mask.shape) < 0.9) & (abs(y - 150) > 55)
    mask[4, 45] = mask[264, 45] = mask[134, [7, 83]] = True
    sides = [np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0)]
    assert [side[-1] - side[0] + 1 for side in sides] == [261, 77] and sides[0][0] and sides[1][0]
    smooth = np.stack([1 + 0.5 * np.sin(x / number + y / 9) for number in (5, 7, 11)], axis=-1)
    image, white = smooth * random.uniform(0.5, 1, (2, *smooth.shape))
    return Capture(image, mask, RIG, white=white, white_clipped=white > 1.3)


# --- the whole procedure, written out ---------------------------------------------------------------------------------


def means_of_blocks(image: np.ndarray, mask: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray]:
    height, width = -(-mask.shape[0] // side), -(-mask.shape[1] // side)
    means, there = np.zeros((height, width, image.shape[2])), np.zeros((height, width), bool)
    for i in range(height):
        for j in range(width):
            block = slice(i * side, (i + 1) * side), slice(j * side, (j + 1) * side)
            if mask[block].any():
                means[i, j], there[i, j] = image[block][mask[block]].mean(axis=0), True
    return means, there


def doubled(answer: np.ndarray, mask: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Normals and expected error (H, W, 4) at twice the resolution, bilinear, from pixels of the mask alone."""
    result = np.zeros((*shape, 4))
    for i in range(shape[0]):
        for j in range(shape[1]):
            y, x = (i + 0.5) / 2 - 0.5, (j + 0.5) / 2 - 0.5
            total, weights = np.zeros(4), 0.0
            for row in (int(np.floor(y)), int(np.floor(y)) + 1):
                for column in (int(np.floor(x)), int(np.floor(x)) + 1):
                    weight = (1 - abs(y - row)) * (1 - abs(x - column))
                    near = min(max(row, 0), len(answer) - 1), min(max(column, 0), answer.shape[1] - 1)
                    if mask[near]:
                        total, weights = total + weight * answer[near], weights + weight
            if weights:
                result[i, j] = total / weights
                result[i, j, :3] /= np.linalg.norm(result[i, j, :3])
    return result


def by_hand(path: Path, capture: Capture) -> np.ndarray:
    """(H, W, 4) normals and confidence, in the camera's frame, of a network of :func:`networks.sees_all`."""
    session, capture = (
        onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"]),
        normalise_by_white_photo(capture),
    )
    rows, columns = (np.flatnonzero(capture.mask.any(axis=axis)) for axis in (1, 0))
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    mask, light = capture.mask[box], capture.image[box].astype(float) @ np.linalg.inv(capture.rig.mixing).T
    means = light[mask].mean(axis=0)
    previous, there = None, None
    for side in (4, 2, 1):
        photo, inside = means_of_blocks(light / means.mean(), mask, side)
        before = np.zeros((*inside.shape, 4))
        if previous is not None and there is not None:
            before = doubled(previous, there, inside.shape) * inside[..., None]
        pixels = np.concatenate([photo, inside[..., None], before], axis=-1)
        pixels = np.pad(pixels, [(0, -inside.shape[0] % 2), (0, -inside.shape[1] % 2), (0, 0)])
        rig = np.concatenate([capture.rig.directions.ravel(), means / means.mean(), [previous is not None, True]])
        normals, confidence = session.run(
            None,
            {
                "pixels": pixels.transpose(2, 0, 1)[None].astype(np.float32),
                "rig": rig.reshape(1, 14, 1, 1).astype("f4"),
            },
        )
        normals = normals[0].transpose(1, 2, 0)[: inside.shape[0], : inside.shape[1]]
        normals = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
        confidence = confidence[0, 0, : inside.shape[0], : inside.shape[1], None]
        previous, there = np.concatenate([normals, (1 - confidence) * np.pi / 2], axis=-1), inside
    answer = np.zeros((*capture.mask.shape, 4))
    answer[box] = np.concatenate([normals, confidence], axis=-1) * mask[..., None]
    return answer


def test_a_pyramid_is_what_loops_make_of_it(tmp_path: Path, ragged: Capture) -> None:
    path = sees_all(tmp_path / "n.onnx", frame="camera")
    expected = by_hand(path, ragged)
    for tile in (64, 1024):
        found = estimate_normals(ragged, path, tile=tile)
        np.testing.assert_allclose(found.vectors, expected[..., :3], rtol=0, atol=1e-4)
        np.testing.assert_allclose(found.confidence, expected[..., 3], rtol=0, atol=1e-4)
    alone = estimate_normals(ragged, sees_all(tmp_path / "one.onnx", frame="camera", kind="dense"))
    assert degrees_between(alone.vectors, found.vectors)[ragged.mask].mean() > 2, "the scales before count"


@pytest.mark.parametrize("kind", ["dense", "pyramid"])
@pytest.mark.parametrize("passes", [1, 6])
def test_tiled_and_untiled_agree_in_turned_frames(tmp_path: Path, ragged: Capture, kind: str, passes: int) -> None:
    model = sees_all(tmp_path / "n.onnx", kind=kind, passes=passes)
    tiled, untiled = (estimate_normals(ragged, model, tile=tile) for tile in (64, 1024))
    np.testing.assert_allclose(tiled.vectors, untiled.vectors, rtol=0, atol=1e-4)
    np.testing.assert_allclose(tiled.confidence, untiled.confidence, rtol=0, atol=1e-4)


def test_how_many_rows_of_the_photo_are_read_at_a_time_does_not_matter(tmp_path, ragged: Capture, monkeypatch) -> None:
    model = OnnxModel(sees_all(tmp_path / "n.onnx"))
    at_once = model(ragged)
    monkeypatch.setattr(dense, "READ_AT_ONCE", 1000)
    np.testing.assert_allclose(model(ragged).vectors, at_once.vectors, rtol=0, atol=1e-5)


# --- what arrives on the finest scale ---------------------------------------------------------------------------------


def ramp(height: int, width: int) -> np.ndarray:
    """(H, W, 3) normals whose slopes grow evenly to the right, and in part upwards; nearly facing, nearly unit."""
    y, x = np.mgrid[:height, :width]
    slopes = 0.1 * (x - width / 2) / width, 0.05 * (height / 2 - y) / height + 0.02
    return np.stack([*slopes, np.ones((height, width))], axis=-1)


@pytest.mark.parametrize("tilts", [(90, 210, 330), (5, 125, 245), (190, 70, 310), (280, 30, 150)])
@pytest.mark.parametrize(("passes", "tile"), [(1, 1024), (6, 1024), (2, 64)])
@pytest.mark.parametrize("magnified", [1.0, 1.68])
def test_coarse_answers_arrive_in_place(tmp_path, tilts: tuple[float, ...], passes: int, tile: int, magnified: float):
    """Of 151 x 211 pixels it says something on 38 x 53 alone. Half a pixel off would be 2.4e-4 in the normals."""
    normals = ramp(151, 211)
    rig = LightRig(direction_from_angles([30.0, 30.0, 30.0], tilts))
    mask = np.pad(np.ones((150, 210), bool), [(1, 0), (1, 0)])
    capture = Capture(normals @ rig.directions.T, mask, rig)
    found = OnnxModel(hands_on(tmp_path / "n.onnx", passes=passes, magnified=magnified), tile=tile)(capture)
    expected = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    # At the edge of the object bilinear interpolation has nothing to go on.
    inner = slice(7, -6), slice(7, -6)
    np.testing.assert_allclose(found.vectors[inner], expected[inner], rtol=0, atol=1e-5)
    np.testing.assert_allclose(found.confidence[mask], 0.5, atol=1e-5)


@pytest.mark.parametrize("shape", [(1, 1), (1, 300), (300, 1), (129, 2), (129, 129)])
@pytest.mark.parametrize("tile", [64, 1024])
@pytest.mark.parametrize("magnified", [1.0, 2.38])
def test_something_flat_stays_flat_however_narrow_and_up_to_the_picture_s_edge(tmp_path, shape, tile, magnified):
    normal = np.array([0.3, -0.2, 0.9]) / np.linalg.norm([0.3, -0.2, 0.9])
    capture = Capture(np.full((*shape, 3), normal @ RIG.directions.T), np.ones(shape, bool), LightRig(RIG.directions))
    model = hands_on(tmp_path / "n.onnx", halo=5, multiple=4, passes=6, magnified=magnified)
    found = estimate_normals(capture, model, tile=tile)
    np.testing.assert_allclose(found.vectors, np.broadcast_to(normal, (*shape, 3)), atol=1e-5)


def resized(values: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Values (h, w, c) on other pixels (H, W), bilinear between the middles of the nearest four."""
    result = np.zeros((*shape, values.shape[2]))
    for i, j in np.ndindex(*shape):
        y, x = ((k + 0.5) * old / new - 0.5 for k, old, new in zip((i, j), values.shape, shape, strict=False))
        for row in (int(np.floor(y)), int(np.floor(y)) + 1):
            for column in (int(np.floor(x)), int(np.floor(x)) + 1):
                near = min(max(row, 0), len(values) - 1), min(max(column, 0), values.shape[1] - 1)
                result[i, j] += (1 - abs(y - row)) * (1 - abs(x - column)) * values[near]
    return result


@pytest.mark.parametrize("times", [1.5, 2.2])
def test_a_small_photo_s_answer_is_that_to_its_magnified_picture(tmp_path: Path, times: float) -> None:
    """Bilinear between pixels of the mask, to which a new pixel belongs as the one does that it lies in."""
    random = np.random.default_rng(4)
    mask = random.random((54, 36)) < 0.8
    mask[[0, -1]] = mask[:, [0, -1]] = True
    capture = Capture(random.uniform(0.1, 1, (54, 36, 3)), mask, RIG)
    plain = OnnxModel(sees_all(tmp_path / "plain.onnx", frame="camera"))
    shape = round(54 * times), round(36 * times)
    rows, columns = ((np.arange(new) + 0.5) * old // new for new, old in zip(shape, mask.shape, strict=True))
    inside = mask[np.ix_(rows.astype(int), columns.astype(int))]
    cover = resized(mask[..., None].astype(float), shape)
    answer = plain(Capture(resized(capture.image * mask[..., None], shape) / np.maximum(cover, 1e-3), inside, RIG))
    both = np.concatenate([answer.vectors, answer.confidence[..., None]], axis=-1) * inside[..., None]
    covered = resized(inside[..., None].astype(float), (54, 36))
    expected = resized(both, (54, 36)) / np.where(mask[..., None], covered, 1)
    found = estimate_normals(capture, sees_all(tmp_path / "n.onnx", frame="camera", magnified=times))
    normals = expected[mask, :3] / np.linalg.norm(expected[mask, :3], axis=-1, keepdims=True)
    np.testing.assert_allclose(found.vectors[mask], normals, rtol=0, atol=1e-4)
    np.testing.assert_allclose(found.confidence[mask], expected[mask, 3], rtol=0, atol=1e-4)


# --- what the network is shown ----------------------------------------------------------------------------------------


# --- progress and memory ----------------------------------------------------------------------------------------------


def test_progress_is_the_share_of_pixels_and_can_cancel_on_any_scale(tmp_path: Path, ragged: Capture) -> None:
    model, told = OnnxModel(hands_on(tmp_path / "n.onnx")), []
    model(ragged, lambda share, message: told.append(share))
    assert told == pytest.approx([0, 1 / 21, 5 / 21, 1])

    def cancel(share: float, message: str) -> None:
        if share > 0.2:
            raise Cancelled

    with pytest.raises(Cancelled):
        model(ragged, cancel)

    told.clear()
    OnnxModel(hands_on(tmp_path / "m.onnx", magnified=1.5))(ragged, lambda share, message: told.append(share))
    # Of the 131 x 39 pixels on the scale before they are 1.5² times as many; those of the last one are 4.
    assert told == sorted(told) and told[-2:] == pytest.approx([2.25 / 6.25, 1])

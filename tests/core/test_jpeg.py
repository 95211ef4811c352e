"""JPEG's losses against libjpeg's own."""

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

torch = pytest.importorskip("torch")

from synthetic import Sphere, write_file

from mpsnet_core.learning.training import jpeg


def jpeg_losses(levels: np.ndarray, quality: int, halved_chroma: bool = True) -> np.ndarray:
    """Of one picture (H, W, 3), after another that must not change it."""
    picture = torch.from_numpy(np.ascontiguousarray(levels.transpose(2, 0, 1))).float()
    both = torch.stack([255 - picture, picture])
    stored = jpeg.jpeg_losses(both, torch.tensor([30.0, quality]), torch.tensor([not halved_chroma, halved_chroma]))
    return stored[1].permute(1, 2, 0).numpy()


@pytest.fixture(scope="module")
def picture(sphere: Sphere) -> np.ndarray:
    """A photo with grain."""
    grain = np.random.Generator(np.random.PCG64(1)).normal(scale=0.02, size=sphere.image.shape)
    return np.rint(255 * np.clip(sphere.image**0.45 + grain, 0, 1))[:64, :48]


@pytest.mark.parametrize("halved", [False, True])
@pytest.mark.parametrize("quality", [40, 60, 75, 90, 98])
def test_losses_are_libjpeg_s(tmp_path: Path, picture: np.ndarray, quality: int, halved: bool) -> None:
    subsampling = "4:2:0" if halved else "4:4:4"
    file = write_file(
        tmp_path / "p.jpg", picture / 255, "uint8", Compression=f"jpeg:{quality}", jpeg__subsampling=subsampling
    )
    source = oiio.ImageInput.open(str(file))
    theirs = np.asarray(source.read_image(oiio.UINT8), float)
    source.close()
    ours = jpeg_losses(picture, quality, halved_chroma=halved)
    loss = np.abs(theirs - picture).mean()
    assert np.abs(ours - picture).mean() == pytest.approx(loss, rel=0.03)
    # What differs are values that lie between two steps and fall to the other side.
    assert np.abs(ours - theirs).mean() < 0.6 * loss
    assert np.abs((ours - theirs).mean(axis=(0, 1))).max() < 0.3

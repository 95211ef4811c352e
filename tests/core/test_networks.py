"""The networks, against their papers' numbers, loops in NumPy, and the mathematics they stand on."""

import itertools

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from small_networks import SMALL
from synthetic import degrees_between, shaded_sphere
from torch import Tensor, nn

from mpsnet_core import Capture, InputError
from mpsnet_core.estimate.features import CONSTANTS, FEATURE_CHANNELS, feature_maps, initial_normals
from mpsnet_core.learning.training.networks import NETWORKS, Network, build_network
from mpsnet_core.scene.rig import direction_from_angles

RIGHT_HANDED = direction_from_angles([25.0, 35.0, 45.0], [80.0, 215.0, 330.0])
LEFT_HANDED = RIGHT_HANDED[[0, 2, 1]]


def small(name: str, seed: int = 0, **options: object) -> Network:
    """The network at a small width and as if trained: signals do not fade, and batch norm has statistics of its own."""
    torch.manual_seed(seed)
    network = build_network(name, SMALL[name] | options).eval()
    for module in network.modules():
        if isinstance(module, nn.Conv2d | nn.ConvTranspose2d):
            nn.init.kaiming_normal_(module.weight)
        elif isinstance(module, nn.BatchNorm2d):
            nn.init.normal_(module.bias, std=0.3)
            nn.init.uniform_(module.weight, 0.5, 1.5)
            nn.init.normal_(module.running_mean, std=0.3)
            nn.init.uniform_(module.running_var, 0.5, 1.5)
    return network


def maps(features: tuple[str, ...], side: int, count: int = 2, seed: int = 0) -> Tensor:
    """Numbers in the place of feature maps."""
    channels, size = sum(FEATURE_CHANNELS[name] for name in features), 1 if features[0] in CONSTANTS else side
    shape = (count, channels, size, size)
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed)) + 0.1


def inputs_of(network: Network, side: int, count: int = 2) -> list[Tensor]:
    return [maps(features, side, count, seed) for seed, features in enumerate(network.inputs.values())]


def told(directions: np.ndarray) -> Tensor:
    """The input "lights"."""
    return torch.from_numpy(directions.astype(np.float32)).reshape(1, 9, 1, 1)


def layers(network: Network) -> list[tuple[int, int, int]]:
    """(channels, maps, side) of each convolution."""
    found = [module for module in network.modules() if isinstance(module, nn.Conv2d | nn.ConvTranspose2d)]
    return [(module.in_channels, module.out_channels, module.kernel_size[0]) for module in found]


MPS_NET = {
    (3, 256, 1),  # conv1
    (256, 256, 1),
    (259, 512, 3),  # with the three components of the initial normals
    (512, 512, 3),
    (512, 1024, 3),
    (1024, 1024, 3),  # conv6, conv7
    (3, 1024, 1),  # conv8, the shortcut
    (1024, 512, 3),
    (512, 3, 3),  # conv10
}


def test_the_widths_are_the_published_ones() -> None:
    with torch.device("meta"):
        found = layers(build_network("mpsnet"))
        assert len(found) == 10 and set(found) == MPS_NET
        assert layers(build_network("psfcn")) == [
            *[(4, 64, 3), (64, 128, 3), (128, 128, 3), (128, 256, 3), (256, 256, 3), (256, 128, 4), (128, 128, 3)],
            *[(128, 128, 3), (128, 128, 3), (128, 128, 3), (128, 64, 4), (64, 3, 3)],
        ]
        bare = layers(build_network("mpsnet", {"normals": False}))
        assert len(bare) == 9 and (256, 512, 3) in bare, "table 1's image only: no initial normals, no shortcut"


def elu(values: np.ndarray) -> np.ndarray:
    return np.where(values > 0, values, np.expm1(np.minimum(values, 0)))


def convolved(values: np.ndarray, layer: nn.Conv2d, stride: int = 1, border: int = 0) -> np.ndarray:
    """(C, H, W) to (M, h, w), place by place; what lies up to `border` beyond the edge is zero."""
    weight = layer.weight.detach().double().numpy()
    bias = 0 if layer.bias is None else layer.bias.detach().double().numpy()
    side, (_, height, width) = weight.shape[2], values.shape
    rows = range(-border, height + border - side + 1, stride)
    columns = range(-border, width + border - side + 1, stride)
    out = np.zeros((len(weight), len(rows), len(columns)))
    for (i, top), (j, left) in itertools.product(enumerate(rows), enumerate(columns)):
        for dy, dx in itertools.product(range(side), repeat=2):
            if 0 <= top + dy < height and 0 <= left + dx < width:
                out[:, i, j] += weight[:, :, dy, dx] @ values[:, top + dy, left + dx]
        out[:, i, j] += bias
    return out


def normed(values: np.ndarray, layer: nn.Sequential, stride: int = 1) -> np.ndarray:
    """Convolution, batch norm by the running statistics, ELU."""
    norm = layer[1]
    mean, variance, scale, shift = (
        value.detach().double().numpy()[:, None, None]
        for value in (norm.running_mean, norm.running_var, norm.weight, norm.bias)
    )
    maps = convolved(values, layer[0], stride, border=1)
    return elu((maps - mean) / np.sqrt(variance + norm.eps) * scale + shift)


def test_mps_net_is_the_paper_s_figure_3() -> None:
    network = small("mpsnet")
    photo, normals = inputs_of(network, 5)
    answers = network(photo, normals).normals.detach().numpy()
    assert answers.shape == (2, 3)
    for image, initial, answer in zip(photo.double().numpy(), normals.double().numpy(), answers, strict=True):
        conv2 = elu(convolved(elu(convolved(image, network.conv1)), network.conv2))
        conv4 = normed(normed(np.concatenate([conv2, initial]), network.conv3), network.conv4)
        conv7 = normed(normed(normed(conv4, network.conv5), network.conv6), network.conv7)
        conv9 = normed(conv7 + convolved(initial, network.conv8), network.conv9, stride=2)
        assert conv9.shape[1:] == (3, 3)
        conv10 = convolved(conv9, network.conv10)
        assert conv10.shape[1:] == (1, 1)
        assert degrees_between(conv10[:, 0, 0], answer) < 1e-3


@pytest.mark.parametrize("directions", [RIGHT_HANDED, LEFT_HANDED], ids=["right-handed", "left-handed"])
def test_a_demultiplexer_that_adds_nothing_is_equation_2(directions: np.ndarray) -> None:
    network = small("demultiplexer")
    nn.init.zeros_(network.layers[-1].weight)
    nn.init.zeros_(network.layers[-1].bias)
    photo = maps(("photo",), 8)
    found = network(photo, told(directions).expand(2, -1, -1, -1)).normals.detach().movedim(1, -1).numpy()
    expected = initial_normals(photo.movedim(1, -1).numpy(), directions)
    assert degrees_between(found, expected).max() < 0.01


def test_psfcn_does_not_care_which_light_is_whose_channel() -> None:
    network = small("psfcn")
    photo = maps(("photo",), 16)
    with torch.no_grad():
        plain = network(photo, told(RIGHT_HANDED).expand(2, -1, -1, -1)).normals
        for order in itertools.permutations(range(3)):
            lights = told(RIGHT_HANDED[list(order)]).expand(2, -1, -1, -1)
            assert torch.equal(network(photo[:, list(order)], lights).normals, plain)
        mismatched = network(photo[:, [1, 0, 2]], told(RIGHT_HANDED).expand(2, -1, -1, -1)).normals
    assert not torch.allclose(mismatched, plain, atol=1e-4), "the lights do matter"


def seen_by(network: Network, capture: Capture, given: dict[str, np.ndarray] | None = None) -> np.ndarray:
    """What the network answers on the capture, (4, H, W): normals and expected error. given: other maps than its."""
    found = given or feature_maps(capture, {name for names in network.inputs.values() for name in names})
    inputs = [np.concatenate([found[name] for name in names]) for names in network.inputs.values()]
    with torch.no_grad():
        prediction = network(*(torch.from_numpy(values)[None] for values in inputs))
    return torch.cat([prediction.normals, prediction.expected_error], dim=1)[0].numpy()


def without_answer(**options: object) -> Network:
    """The default, with a last layer that says nothing."""
    network = small("multiscale", **options)
    nn.init.zeros_(network.answer.weight)
    nn.init.zeros_(network.answer.bias)
    return network


def test_a_default_that_adds_nothing_is_grey_world_at_first_and_then_what_was_there_before() -> None:
    network, capture = without_answer(), shaded_sphere(32, albedo=(0.9, 0.5, 0.3)).capture()
    network.answer.bias.data[7] = -30  # no weight for the formula
    found = feature_maps(capture, {"initial_normals_grey_world", *network.inputs["pixels"], *network.inputs["rig"]})
    inside = capture.mask
    first = seen_by(network, capture)[:3, inside]
    assert degrees_between(first.T, found["initial_normals_grey_world"][:, inside].T).max() < 0.1
    before = np.random.default_rng(0).standard_normal((4, *inside.shape)).astype(np.float32) * inside
    before[:3] /= np.maximum(np.linalg.norm(before[:3], axis=0), 1e-6)
    given = {**found, "previous": before, "given": np.float32([1, 0]).reshape(2, 1, 1)}
    second = seen_by(network, capture, given)[:3, inside]
    assert degrees_between(second.T, before[:3, inside].T).max() < 0.1


def test_a_default_that_trusts_the_formula_alone_is_equation_2() -> None:
    network, capture = without_answer(), shaded_sphere(32, albedo=(0.9, 0.5, 0.3)).capture()
    network.answer.bias.data[7], network.answer.bias.data[8] = 30, -30
    expected = feature_maps(capture, ["initial_normals"])["initial_normals"]
    found = seen_by(network, capture)[:3]
    assert degrees_between(found[:, capture.mask].T, expected[:, capture.mask].T).max() < 0.1


def test_frozen_norms_answer_in_training_as_they_do_afterwards() -> None:
    network = small("multiscale").double()
    inputs = [values.double() for values in inputs_of(network, 32)]
    expected = network(*inputs).normals
    network.train()
    for norm in (module for module in network.modules() if isinstance(module, nn.BatchNorm2d)):
        norm.eval()
    assert float((network(*inputs).normals - expected).detach().abs().max()) < 1e-5


def test_the_default_measures_the_surface_s_colour_by_its_own_normals() -> None:
    """Where these are true, equation 2 without the colour that it measures is the truth, and with it far from that."""
    network, sphere = without_answer(), shaded_sphere(96, albedo=(0.9, 0.5, 0.3))
    network.answer.bias.data[7] = 30
    network.answer.bias.data[3] = -4  # sure of its normals
    capture = sphere.capture()
    found = feature_maps(capture, {*network.inputs["pixels"], *network.inputs["rig"]})
    before = np.concatenate([sphere.normals.transpose(2, 0, 1), np.full((1, 96, 96), 0.02)]) * capture.mask
    given = {**found, "previous": before.astype(np.float32), "given": np.float32([1, 0]).reshape(2, 1, 1)}
    bright = capture.mask & (capture.image > 0.1).all(axis=-1)
    errors = []
    for share in (-30, 30):
        network.answer.bias.data[8] = share
        answer = seen_by(network, capture, given)[:3, bright].T
        errors.append(degrees_between(answer, sphere.normals[bright]).mean())
    assert errors[0] > 10 and errors[1] < 0.5


@pytest.mark.parametrize("name", sorted(set(NETWORKS) - {"mpsnet", "multiscale"}))
def test_no_network_sees_farther_than_its_halo(name: str) -> None:
    """With layers that weigh all they see, and positively, no influence is lost, nor cancels out."""
    network = build_network(name, SMALL[name]).double().eval()
    for value in network.parameters():
        value.data = torch.rand_like(value) + 0.1
        if value.ndim > 1:
            value.data /= value[0].sum()
    side = (2 * network.halo // network.multiple + 4) * network.multiple + 8 // network.multiple * network.multiple
    image, *others = (values.double() for values in inputs_of(network, side, count=1))
    prediction = network(image.requires_grad_(), *others)
    reaches = []
    middle = side // 2 // network.multiple * network.multiple
    for place in range(middle, middle + network.multiple, max(1, network.multiple // 4)):
        (gradient,) = torch.autograd.grad(prediction.normals[0, 0, place, place], image, retain_graph=True)
        rows, columns = np.nonzero(gradient.abs().sum(dim=(0, 1)).numpy())
        reaches.append(max(place - min(rows.min(), columns.min()), max(rows.max(), columns.max()) - place))
    assert network.halo - network.multiple < max(reaches) <= network.halo, "a halo too large costs time"


def test_what_lies_beyond_the_default_s_halo_hardly_counts() -> None:
    """By its layers the default sees 133 pixels far, which would cost large photos much time; 96 leave next to nothing.

    The middle rows of a picture are the same, seen whole or with no more than the halo about them.
    """
    torch.manual_seed(1)
    network = build_network("multiscale").eval()
    pixels, rig = inputs_of(network, 400, count=1)
    rows, beside = slice(192, 208), network.halo
    with torch.no_grad():
        whole, part = network(pixels, rig), network(pixels[:, :, rows.start - beside : rows.stop + beside], rig)
        narrow = network(pixels[:, :, rows.start - 16 : rows.stop + 16], rig)
    torch.testing.assert_close(part.normals[:, :, beside : beside + 16], whole.normals[:, :, rows], rtol=0, atol=1e-4)
    assert not torch.allclose(narrow.normals[:, :, 16:32], whole.normals[:, :, rows], rtol=0, atol=1e-4)


@pytest.mark.parametrize("name", sorted(NETWORKS))
def test_answers_are_unit_vectors_and_of_the_picture_s_size(name: str) -> None:
    network = small(name)
    side = network.patch if network.kind == "patch" else 3 * network.multiple
    prediction = network(*inputs_of(network, side))
    assert prediction.normals.shape == ((2, 3) if network.kind == "patch" else (2, 3, side, side))
    torch.testing.assert_close(prediction.normals.norm(dim=1), torch.ones_like(prediction.normals[:, 0]))
    if prediction.expected_error is not None:
        assert prediction.expected_error.shape == (2, 1, side, side) and (prediction.expected_error >= 0).all()


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("resnet", {}, "there is no network 'resnet'; choose demultiplexer"),
        ("mpsnet", {"widht": 1}, "unexpected keyword argument 'widht'; correct the recipe"),
        ("mpsnet", {"patch": 4}, "patch 4 is not an odd number from 1 to 15"),
        ("mpsnet", {"width": "wide"}, "width 'wide' is not a number above 0 and up to 4"),
        ("demultiplexer", {"width": 1e9}, "width 1000000000.0 is not a number above 0"),
        ("multiscale", {"widths": [4, 4, 4]}, "widths [4, 4, 4] are not four whole numbers from 1 to 4096"),
        ("multiscale", {"widths": "4444"}, "widths '4444' are not four whole numbers"),
    ],
)
def test_options_that_no_network_has_are_reported(name: str, options: dict[str, object], words: str) -> None:
    with pytest.raises(InputError) as caught:
        build_network(name, options)
    assert words in str(caught.value)

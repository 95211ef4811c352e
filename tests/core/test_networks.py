"""The networks, against their papers' numbers, loops in NumPy, and the mathematics they stand on."""

import itertools

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from small_networks import SMALL
from synthetic import degrees_between, shaded_sphere
from torch import Tensor, nn

from mpsnet_core.capture.capture import Capture
from mpsnet_core.errors import InputError
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
        half = layers(build_network("mpsnet", {"width": 0.5}))
        assert {maps for _, maps, _ in half} == {128, 256, 512, 3}
        bare = layers(build_network("mpsnet", {"normals": False}))
        assert len(bare) == 9 and (256, 512, 3) in bare, "table 1's image only: no initial normals, no shortcut"


def test_the_paper_s_work_a_patch_and_what_sharing_would_save() -> None:
    with torch.device("meta"):
        found = layers(build_network("mpsnet"))
    places = [25] * 8 + [9, 1]
    work = [n * channels * maps * side**2 for n, (channels, maps, side) in zip(places, found, strict=True)]
    assert found[7] == (3, 1024, 1)
    assert sum(work) == pytest.approx(0.72e9, rel=0.01)
    assert (sum(work[:3]) + work[7]) / sum(work) == pytest.approx(0.04, abs=0.005)


def test_the_default_is_small() -> None:
    assert sum(value.numel() for value in build_network("multiscale").parameters()) <= 2_000_000


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


@pytest.mark.parametrize("side", [1, 3, 7, 9])
def test_patches_of_table_1_end_in_one_pixel(side: int) -> None:
    for normals in (True, False):
        network = small("mpsnet", patch=side, normals=normals)
        assert network(*inputs_of(network, side)).normals.shape == (2, 3)


def test_dropout_takes_single_places_away_in_training_alone() -> None:
    network = small("mpsnet", width=0.2)
    seen: list[tuple[Tensor, Tensor]] = []
    network.dropout.register_forward_hook(lambda module, given, out: seen.append((given[0], out)))
    inputs = inputs_of(network, 5, count=20)
    with torch.no_grad():
        network(*inputs)
        assert len(seen) == 2, "after conv3 and conv5"
        assert all(torch.equal(given, out) for given, out in seen)
        seen.clear()
        network.train()(*inputs)
    for given, out in seen:
        gone = (out == 0) & (given != 0)
        assert gone.float().mean() == pytest.approx(0.1, abs=0.01)
        whole = gone.float().mean(dim=(2, 3))
        assert not (whole == 1).any(), "no map is lost as a whole"
        torch.testing.assert_close(out[~gone], given[~gone] / 0.9)


def test_only_the_first_layers_are_shared_between_overlapping_patches() -> None:
    """As the module says: conv1, conv2 and conv8 exactly, conv3 in nine variants, from conv4 on nothing."""
    network = small("mpsnet")
    photo, normals = inputs_of(network, 9, count=1)
    seen: dict[str, Tensor] = {}
    names = ["conv1", "conv2", "conv3", "conv4", "conv8"]
    hooks = {name: getattr(network, name) for name in names} | {"conv3 bare": network.conv3[0]}
    for name, module in hooks.items():
        module.register_forward_hook(lambda module, given, out, name=name: seen.update({name: out}))
    with torch.no_grad():
        # All the patches that hold the picture's middle pixel; in patch (i, j) it stands at place (4 - i, 4 - j).
        network(*(values[0].unfold(1, 5, 1).unfold(2, 5, 1).flatten(1, 2).movedim(1, 0) for values in (photo, normals)))
        patches = {name: values.unflatten(0, (5, 5)) for name, values in seen.items()}
        middle = {
            name: torch.stack([values[i, j, :, 4 - i, 4 - j] for i, j in itertools.product(range(5), repeat=2)])
            for name, values in patches.items()
        }
        for name in ("conv1", "conv2", "conv8"):
            torch.testing.assert_close(middle[name], middle[name][:1].expand(25, -1), atol=1e-5, rtol=0)
        # The nine variants: the kernel without what the patch's edge cuts off, over the whole picture.
        image = network.elu(network.conv2(network.elu(network.conv1(photo))))
        stacked = torch.cat([image, normals], dim=1)
        variants = {}
        for down, right in itertools.product((0, 1, 2), repeat=2):  # at the edge above (left), none, below (right)
            kernel = network.conv3[0].weight.clone()
            kernel[:, :, (0, 3, 2)[down] : (1, 3, 3)[down]] = 0
            kernel[:, :, :, (0, 3, 2)[right] : (1, 3, 3)[right]] = 0
            variants[down, right] = nn.functional.conv2d(stacked, kernel, padding=1)[0, :, 4, 4]
        edge = (0, 1, 1, 1, 2)
        for number, (i, j) in enumerate(itertools.product(range(5), repeat=2)):
            torch.testing.assert_close(middle["conv3 bare"][number], variants[edge[4 - i], edge[4 - j]])
        for name, kinds in (("conv3", 9), ("conv4", 25)):
            apart = torch.cdist(middle[name], middle[name]) > 1e-4
            assert len({tuple(row.tolist()) for row in apart}) == kinds, name


@pytest.mark.parametrize("directions", [RIGHT_HANDED, LEFT_HANDED], ids=["right-handed", "left-handed"])
def test_a_demultiplexer_that_adds_nothing_is_equation_2(directions: np.ndarray) -> None:
    network = small("demultiplexer")
    nn.init.zeros_(network.layers[-1].weight)
    nn.init.zeros_(network.layers[-1].bias)
    photo = maps(("photo",), 8)
    found = network(photo, told(directions).expand(2, -1, -1, -1)).normals.detach().movedim(1, -1).numpy()
    expected = initial_normals(photo.movedim(1, -1).numpy(), directions)
    assert degrees_between(found, expected).max() < 0.01


def test_a_demultiplexer_sees_every_pixel_on_its_own() -> None:
    network = small("demultiplexer")
    photo, lights = maps(("photo",), 8), told(RIGHT_HANDED).expand(2, -1, -1, -1)
    with torch.no_grad():
        mixed = network(photo.transpose(2, 3).flip(2), lights).normals
        torch.testing.assert_close(mixed, network(photo, lights).normals.transpose(2, 3).flip(2))


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


def test_exposure_does_not_change_the_default_s_answer() -> None:
    network, sphere = small("multiscale"), shaded_sphere(32)
    image, white = sphere.image + np.random.default_rng(2).random((2, *sphere.image.shape), np.float32) / 10
    plain = seen_by(network, sphere.capture(image=image, white=white))
    assert np.ptp(plain[0][sphere.mask]) > 0.5, "the answer says something"
    for gains in ((10, 0.1), (0.2, 7)):
        changed = seen_by(network, sphere.capture(image=image * gains[0], white=white * gains[1]))
        np.testing.assert_allclose(changed, plain, atol=1e-3 * abs(plain).max())


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
        ("mpsnet", {"patch": 5.0}, "patch 5.0 is not an odd number"),
        ("mpsnet", {"width": "wide"}, "width 'wide' is not a number above 0 and up to 4"),
        ("psfcn", {"width": -1}, "width -1 is not a number above 0 and up to 4"),
        ("demultiplexer", {"width": float("inf")}, "width inf is not a number"),
        ("demultiplexer", {"width": 1e9}, "width 1000000000.0 is not a number above 0"),
        ("multiscale", {"widths": [4, 4, 4]}, "widths [4, 4, 4] are not four whole numbers from 1 to 4096"),
        ("multiscale", {"widths": [4, 4, 4, -4]}, "are not four whole numbers"),
        ("multiscale", {"widths": "4444"}, "widths '4444' are not four whole numbers"),
        ("multiscale", {"widths": 32}, "widths 32 are not four whole numbers"),
    ],
)
def test_options_that_no_network_has_are_reported(name: str, options: dict[str, object], words: str) -> None:
    with pytest.raises(InputError) as caught:
        build_network(name, options)
    assert words in str(caught.value)

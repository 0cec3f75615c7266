import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from ringlight.errors import ModelFileError, SceneError
from ringlight.measure.lpips import LAYERS, Lpips, tensor_shapes, weights_folder, weights_path, weights_status

NETS = ("alex", "vgg")


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("RINGLIGHT_CACHE", str(tmp_path))
    return tmp_path


def synthetic_weights(net: str) -> dict[str, torch.Tensor]:
    """Random weights of the right shapes, sized so that signals keep their magnitude."""
    generator = torch.Generator().manual_seed(5)
    weights = {}
    for name, shape in tensor_shapes(net).items():
        spread = (2 / np.prod(shape[1:])) ** 0.5 if len(shape) == 4 else 0.1
        tensor = torch.randn(shape, generator=generator) * spread
        weights[name] = tensor.abs() if name.startswith("heads") else tensor
    return weights


def install(net: str) -> dict[str, torch.Tensor]:
    weights = synthetic_weights(net)
    save_file(weights, weights_path(net))
    return weights


def picture(seed: int, height: int = 37, width: int = 42) -> torch.Tensor:
    return torch.rand(height, width, 3, generator=torch.Generator().manual_seed(seed))


def distance_by_numpy(net: str, weights: dict[str, torch.Tensor], image, truth, rescale: bool) -> float:
    """The distance in double precision, one convolution at a time."""
    shift, scale = np.array([-0.030, -0.088, -0.188]), np.array([0.458, 0.448, 0.450])
    features = [a.double().numpy() * (2 if rescale else 1) - (1 if rescale else 0) for a in (image, truth)]
    features = [((a - shift) / scale).transpose(2, 0, 1) for a in features]
    taps = []
    for index, layer in enumerate(LAYERS[net]):
        kernel, bias = (weights[f"features.{index}.{part}"].double().numpy() for part in ("weight", "bias"))
        features = [conv(pool(a, layer.pool), kernel, bias, layer.stride, layer.padding) for a in features]
        if layer.tap:
            taps.append(features)
    total = 0.0
    for head, (a, b) in enumerate(taps):
        a, b = (f / np.linalg.norm(f, axis=0) for f in (a, b))
        total += np.einsum("c,chw->", weights[f"heads.{head}"].double().numpy(), (a - b) ** 2) / a[0].size
    return total


def pool(a: np.ndarray, width: int) -> np.ndarray:
    if not width:
        return a
    windows = np.lib.stride_tricks.sliding_window_view(a, (width, width), axis=(1, 2))
    return windows[:, ::2, ::2].max(axis=(3, 4))


def conv(a: np.ndarray, kernel: np.ndarray, bias: np.ndarray, stride: int, padding: int) -> np.ndarray:
    padded = np.pad(a, ((0, 0), (padding, padding), (padding, padding)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, kernel.shape[2:], axis=(1, 2))[:, ::stride, ::stride]
    return np.maximum(np.tensordot(kernel, windows, axes=([1, 2, 3], [0, 3, 4])) + bias[:, None, None], 0)


@pytest.mark.parametrize("rescale", [True, False])
def test_alex_is_the_network_written_out(cache, rescale):
    weights = install("alex")
    image, truth = picture(1), picture(2)
    expected = distance_by_numpy("alex", weights, image, truth, rescale)
    assert Lpips("alex")(image, truth, rescale=rescale) == pytest.approx(expected, rel=1e-3)


def test_vgg_is_the_network_written_out(cache):
    weights = install("vgg")
    image, truth = picture(1, 17, 18), picture(2, 17, 18)
    expected = distance_by_numpy("vgg", weights, image, truth, rescale=True)
    assert Lpips("vgg")(image, truth) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("net", NETS)
def test_distance_is_zero_for_equal_images_symmetric_and_grows_with_noise(cache, net):
    install(net)
    measure = Lpips(net)
    truth, noise = picture(3), picture(4) - 0.5
    assert measure(truth, truth) == 0
    distances = [measure((truth + amount * noise).clamp(0, 1), truth) for amount in (0.05, 0.2, 0.8)]
    assert 0 < distances[0] < distances[1] < distances[2]
    image = (truth + 0.2 * noise).clamp(0, 1)
    assert measure(image, truth) == pytest.approx(measure(truth, image), rel=1e-5)


def test_missing_weights_come_with_their_remedy(cache):
    for net in NETS:
        assert "'ringlight fetch-lpips'" in weights_status(net)
        with pytest.raises(ModelFileError, match="fetch-lpips"):
            Lpips(net)
    install("alex")
    assert weights_status("alex") == ""
    assert weights_status("vgg") != ""


def test_damaged_weights_are_refused(cache):
    install("alex")
    path = weights_path("alex")
    path.write_bytes(path.read_bytes()[:-1000])
    with pytest.raises(ModelFileError, match="cannot be read"):
        Lpips("alex")
    save_file({"features.0.bias": torch.zeros(64)}, path)
    with pytest.raises(ModelFileError, match="other tensors"):
        Lpips("alex")


def test_images_below_the_network_are_refused_in_words(cache):
    for net in NETS:
        install(net)
    assert Lpips("alex")(picture(1, 31, 31), picture(2, 31, 31)) > 0
    assert Lpips("vgg")(picture(1, 16, 16), picture(2, 16, 16)) > 0
    with pytest.raises(SceneError, match="31 x 31 pixels or more, not 50 x 30"):
        Lpips("alex")(picture(1, 30, 50), picture(2, 30, 50))


def test_the_cache_follows_the_environment(monkeypatch, tmp_path):
    monkeypatch.delenv("RINGLIGHT_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert weights_folder() == tmp_path / "xdg" / "ringlight"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert weights_folder() == tmp_path / ".cache" / "ringlight"
    monkeypatch.setenv("RINGLIGHT_CACHE", str(tmp_path / "chosen"))
    assert weights_path("vgg") == tmp_path / "chosen" / "lpips-vgg.safetensors"


def test_the_published_weights_prefer_structure_to_pixels():
    """A shift of two pixels looks alike and differs in every pixel; noise of the same PSNR does not look alike."""
    if remedy := weights_status("alex"):
        pytest.skip(remedy)
    y, x = torch.meshgrid(torch.arange(96.0), torch.arange(96.0), indexing="ij")
    truth = torch.stack(
        [0.5 + 0.4 * torch.sin(x / 6), 0.5 + 0.4 * torch.cos(y / 5), 0.5 + 0.4 * torch.sin((x + y) / 9)], -1
    )
    shifted = truth.roll(2, dims=1)
    error = (shifted - truth).square().mean().sqrt()
    noisy = truth + error * torch.randn(truth.shape, generator=torch.Generator().manual_seed(0))
    measure = Lpips("alex")
    assert measure(shifted, truth) < 0.25 * measure(noisy, truth)

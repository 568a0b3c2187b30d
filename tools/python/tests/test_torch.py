"""Tests the forward model for PyTorch. Its images equal the images of a hologram, its gradients are derivatives, and a
loop of Adam over it is as good as a solve."""

import eyebox
import numpy as np
import pytest
from conftest import named

torch = pytest.importorskip("torch", reason="PyTorch is not installed")
import eyebox.torch  # noqa: E402

PUPILS = [(3e-3, -2e-3, 9e-3, 4e-3), (-5e-3, 1e-3, 5e-3, -1e-3)]
TERMS = {
    "level": 1.04,
    "bend": [0.1, -0.05],
    "lag": 0.1,
    "crosstalk": [[1.2, 2.03]] * 4,
    "fill": 0.9,
    "source": [0.1, -0.05, -0.3, 0.08, -0.2],
    "undiffracted": [0.15, 0.1, 0.4, -0.3, 0.2],
    "wavefront": {"4": 0.15, "7": 0.05},
}
DISPLAYS = {
    "ideal": eyebox.Display("small", size=(40, 48)),
    "bench": eyebox.Display("small", size=(40, 48), model={"green": TERMS}, source={"green": {"image_mm": 0.5}}),
}


def random_phases(*shape, seed=1):
    """Phases that are not near the wrap of a drive, because the images jump there."""
    return torch.from_numpy(np.random.default_rng(seed).uniform(0.1, 6.1, shape).astype(np.float32))


def model_of(name, frames=2, engine="cpu", **options):
    return eyebox.torch.ForwardModel(DISPLAYS[name], "green", frames, engine=engine, **options)


@pytest.mark.parametrize("name", DISPLAYS)
def test_images_are_those_of_a_hologram(name):
    phases = random_phases(2, 40, 48)
    images = model_of(name, exposure=0.5)(phases, PUPILS)
    assert images.shape == (2, 40, 48) and images.dtype == torch.float32
    hologram = eyebox.Hologram.from_phases(phases, DISPLAYS[name], "green", exposure=0.5)
    for image, pupil in zip(images, PUPILS):
        np.testing.assert_array_equal(image.numpy(), hologram.view(*pupil, engine="cpu")[..., 0])
    # Whole turns do not change the images, and other types are converted.
    turned = model_of(name, exposure=0.5)(phases.double() + 4 * np.pi, PUPILS)
    assert turned.dtype == torch.float32
    torch.testing.assert_close(turned, images, rtol=1e-3, atol=1e-3)


def exact_images(phases, display):
    """The images of an ideal display in float64."""
    wavelength, (rows, columns) = display.wavelengths["green"], display.resolution
    y, x = np.meshgrid(*(np.fft.fftfreq(n, display.pitch) for n in (rows, columns)), indexing="ij")
    spectrum = np.fft.fft2(np.exp(1j * phases))
    side = wavelength * display.focal_length / display.pitch
    for at_x, at_y, diameter, depth in PUPILS:
        place = wavelength * display.focal_length * np.array([x, y])
        passes = np.hypot(place[0] - at_x, place[1] - at_y) < diameter / 2
        a = wavelength**2 * (x**2 + y**2)
        kernel = passes * np.exp(-2j * np.pi * depth / wavelength * a / (1 + np.sqrt(1 - a)))
        yield (np.abs(np.fft.ifft2(spectrum * kernel)) ** 2).mean(0) / (np.pi / 4 * (diameter / side) ** 2)


def test_the_gradient_is_the_derivative_in_float64():
    targets = np.random.default_rng(2).random((2, 40, 48))
    phases = random_phases(2, 40, 48).requires_grad_()
    images = model_of("ideal")(phases, PUPILS)
    (0.7 * images - torch.from_numpy(targets)).square().mean().backward()
    exact = phases.detach().double().numpy()

    def loss(phases):
        return np.mean((0.7 * np.array(list(exact_images(phases, DISPLAYS["ideal"]))) - targets) ** 2)

    seen = np.array(list(exact_images(exact, DISPLAYS["ideal"])))
    np.testing.assert_allclose(images.detach().numpy(), seen, atol=1e-5 * seen.max())
    for seed in range(3):
        direction, h = np.random.default_rng(seed).standard_normal(exact.shape), 1e-5
        numeric = (loss(exact + h * direction) - loss(exact - h * direction)) / (2 * h)
        closed = np.sum(phases.grad.double().numpy() * direction)
        assert abs(closed / numeric - 1) < 1e-4, (closed, numeric)


@pytest.mark.parametrize("name", DISPLAYS)
def test_the_gradient_is_the_derivative_of_the_images(name):
    """Differences of float32 images along the gradient, in which the change is large compared with rounding."""
    model, phases = model_of(name, frames=3), random_phases(3, 40, 48).requires_grad_()
    weights = torch.from_numpy(np.random.default_rng(3).standard_normal((2, 40, 48)))

    def loss(phases):
        return (model(phases, PUPILS).double().square() * weights).sum()

    loss(phases).backward()
    along = phases.grad / phases.grad.abs().max()
    along = along + 0.1 * torch.from_numpy(np.random.default_rng(4).standard_normal(along.shape).astype(np.float32))
    with torch.no_grad():
        at = {step: loss(phases + 4e-3 * step * along).item() for step in (-2, -1, 1, 2)}
    numeric = (8 * (at[1] - at[-1]) - (at[2] - at[-2])) / (12 * 4e-3)
    closed = (phases.grad.double() * along.double()).sum().item()
    assert abs(closed / numeric - 1) < 1e-4, (closed, numeric)


@pytest.mark.parametrize("name", DISPLAYS)
def test_both_engines_agree(name):
    try:
        engine = eyebox.Engine("vulkan")
    except eyebox.EngineError:
        pytest.skip("there is no Vulkan device")
    results = []
    for engine in ("cpu", engine):
        phases = random_phases(2, 40, 48).requires_grad_()
        images = model_of(name, engine=engine)(phases, PUPILS)
        images.square().mean().backward()
        results.append((images.detach(), phases.grad))
    for cpu, device in zip(*results):
        assert (device - cpu).norm() < 1e-5 * cpu.norm()


def test_parts_of_a_program():
    """The exposure is trained too, tensors of other types get a gradient of their type, and changes are noticed."""
    exposure = torch.nn.Parameter(torch.tensor(0.5))
    model = model_of("ideal", exposure=exposure)
    assert list(model.parameters()) == [exposure] and "green" in repr(model)
    phases = random_phases(2, 40, 48).double().requires_grad_()
    images = model(phases, torch.tensor(PUPILS, dtype=torch.float64))
    images.sum().backward()
    assert phases.grad.dtype == torch.float64 and phases.grad.abs().max() > 0
    torch.testing.assert_close(exposure.grad, (images / exposure).sum().detach(), rtol=1e-4, atol=0.0)
    with torch.no_grad():
        assert not model(phases, PUPILS).requires_grad
    [again] = torch.autograd.grad(model(phases, PUPILS).square().sum(), phases, create_graph=True)
    with pytest.raises(RuntimeError):
        again.sum().backward()
    loss = model(phases, PUPILS).sum()
    with torch.no_grad():
        phases += 1
    with pytest.raises(RuntimeError):
        loss.backward()


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda m: m(torch.zeros(3, 40, 48), PUPILS), "phases 3 40 48 2"),
        (lambda m: m(torch.zeros(40, 48), PUPILS), "phases 40 48 3"),
        (lambda m: m(torch.zeros(2, 40, 48, dtype=torch.int64), PUPILS), "phases int64"),
        (lambda m: m(np.zeros((2, 40, 48)), PUPILS), "phases ndarray"),
        (lambda m: m(torch.full((2, 40, 48), torch.nan), PUPILS), "phase NaN 0"),
        (lambda m: m(torch.zeros(2, 40, 48), [(0, 0, 4e-3)]), "pupils"),
        (lambda m: m(torch.zeros(2, 40, 48), [(1, 0, 4e-3, 0)]), "pupil"),
        (lambda m: eyebox.torch.ForwardModel(m.display), "color red green blue"),
        (lambda m: eyebox.torch.ForwardModel(m.display, "pink"), "color pink"),
        (lambda m: eyebox.torch.ForwardModel(m.display, "green", 0), "frames 0"),
        (lambda m: eyebox.torch.ForwardModel(m.display, "green", exposure=np.inf), "exposure inf"),
    ],
)
def test_what_makes_no_sense_is_named(call, says):
    with named((ValueError, TypeError), *says.split()):
        call(model_of("ideal"))


def test_a_loop_of_adam_is_as_good_as_a_solve():
    """The same rates, exposure and distribution of pupils as in the solve. Phases and pupils are other random ones, which
    scatters the result by 0.03 dB."""
    display, frames, steps, pupils = eyebox.Display("small", size=(128, 128)), 4, 40, 8
    scene = eyebox.Scene("builtin:still-life", display, "green")
    settings = dict(diameter=(10e-3, 16e-3), depth=(0, 2e-3), diameters="uniform", window="full", first_phases="random")
    solved = eyebox.solve(scene, frames=frames, steps=steps, pupils=pupils, optimizer="adam", engine="cpu", **settings)
    # Points of one sequence avoid each other, so the scores have pupils of another sequence.
    points, others = (torch.quasirandom.SobolEngine(4, scramble=True, seed=seed) for seed in (1, 99))

    def draw(points, count):
        for d, x, y, z in points.draw(count).tolist():
            diameter = 10e-3 + 6e-3 * d
            reach = (display.eyebox - diameter) / 2
            yield reach * (2 * x - 1), reach * (2 * y - 1), diameter, 2e-3 * z

    model = eyebox.torch.ForwardModel(display, "green", frames, exposure=solved.exposures["green"], engine="cpu")
    generator = torch.Generator().manual_seed(1)
    phases = (2 * torch.pi * torch.rand(frames, 128, 128, generator=generator)).requires_grad_()
    adam = torch.optim.Adam([phases], lr=0.2, eps=1e-11)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(adam, steps, eta_min=0.01)
    for _ in range(steps):
        at = list(draw(points, pupils))
        targets = torch.from_numpy(np.stack([scene.photograph(*pupil, engine="cpu")[..., 0] for pupil in at]))
        adam.zero_grad()
        (model(phases, at) - targets).square().mean().backward()
        adam.step()
        schedule.step()
    own = eyebox.Hologram.from_phases(phases.detach(), display, "green", scene=scene, engine="cpu")
    at = list(draw(others, 32))
    mean = [np.mean([score.psnr for score in one.score(scene, at, engine="cpu")]) for one in (own, solved)]
    print(f"Adam of PyTorch {mean[0]:.2f} dB, Adam of the engine {mean[1]:.2f} dB")
    assert abs(mean[0] - mean[1]) < 0.1, mean

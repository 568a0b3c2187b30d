"""The forward model of a display as a module of PyTorch, for methods of your own that train through a calibrated bench.

The engine of eyebox computes the images and the gradients. The rest of the program can be any PyTorch.

>>> import torch, eyebox, eyebox.torch
>>> model = eyebox.torch.ForwardModel(eyebox.Display("small", size=(32, 32)), color="green", frames=2)
>>> phases = (6.28 * torch.rand(2, 32, 32)).requires_grad_()
>>> images = model(phases, [(2e-3, 0, 4e-3, 1e-3), (0, 0, 8e-3, 0)])
>>> images.square().mean().backward()
>>> tuple(images.shape), tuple(phases.grad.shape)
((2, 32, 32), (2, 32, 32))
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from . import _arguments, _eyebox
from ._display import Display, display_of, engine_of

try:
    import torch
    from torch.autograd.function import once_differentiable
except ImportError:
    raise ImportError("eyebox.torch needs PyTorch: pip install torch") from None

if TYPE_CHECKING:
    from ._types import DisplayLike, EngineLike, Pupils, Whole

__all__ = ["ForwardModel"]


class ForwardModel(torch.nn.Module):
    """The images that an eye sees of phases, as a module with a gradient.

    An image has the values of :meth:`eyebox.Hologram.view`. It is the mean intensity over the sub-frames, times the
    exposure, through the display's model, its source and the eye's prescription. Its pixels are the pixels of the
    picture, also for small pupils. The gradient belongs to these values. The phases are not rounded to the levels of
    the SLM, because levels have no derivative.

    Each color has its own phases, so several colors are several models. A model has no padding and no obstruction of
    the pupil.

    Parameters
    ----------
    display : Display, str or path
        Display with its model.
    color : str, optional
        Color of the phases. It is optional if the display has only one color.
    frames : int
        Sub-frames, which are shown one after the other.
    exposure : float or torch.Tensor
        Factor of the light, the same for all pupils. A ``torch.nn.Parameter`` is trained too.
    engine : Engine or str
        Engine that computes. Tensors on a device pass through the memory of the host.
    """

    def __init__(
        self,
        display: DisplayLike,
        color: str | None = None,
        frames: Whole = 8,
        *,
        exposure: float | torch.Tensor = 1.0,
        engine: EngineLike = "auto",
    ) -> None:
        super().__init__()
        self.display: Display = display_of(display)
        names = _arguments.colors(color, list(self.display.wavelengths))
        if len(names) != 1:
            raise _arguments.wrong(ValueError, "color", f"is {color!r}: it must be one of {', '.join(self.display.wavelengths)}")
        [self.color] = names
        self.frames = _arguments.count(frames, "frames", 4096)
        self.exposure = exposure if isinstance(exposure, torch.Tensor) else _arguments.finite(exposure, "exposure")
        self._engine = engine_of(engine)
        self._native = _eyebox.ForwardModel(self.display._native, self.color, self.frames)

    def forward(self, phases: torch.Tensor, pupils: Pupils) -> torch.Tensor:
        """Computes the images of phases through pupils.

        Parameters
        ----------
        phases : torch.Tensor
            Floating-point radians (sub-frame, row, column). The engine computes in float32.
        pupils : sequence of (x, y, diameter, depth)
            Pupils in meters, or with units as everywhere in eyebox.

        Returns
        -------
        torch.Tensor
            (pupil, row, column), float32, linear light, on the device of the phases.
        """
        if not (isinstance(phases, torch.Tensor) and phases.is_floating_point()):
            kind = phases.dtype if isinstance(phases, torch.Tensor) else type(phases).__name__
            right = "a floating-point tensor of radians (sub-frame, row, column)"
            raise _arguments.wrong(TypeError, "phases", f"is {kind}: it must be {right}")
        at = _arguments.pupils(pupils, lambda: self.display.focal_length)
        return _Images.apply(phases, self._native, at, self._engine) * self.exposure

    def extra_repr(self) -> str:
        """Returns the description of the model for ``repr``."""
        return f"{self.display!r}, {self.color}, frames={self.frames}"


class _Images(torch.autograd.Function):
    """Images without exposure. The gradient with respect to the phases is the adjoint of the engine."""

    @staticmethod
    def forward(ctx: Any, phases: torch.Tensor, native: _eyebox.ForwardModel, at: Any, engine: Any) -> torch.Tensor:
        ctx.save_for_backward(phases)
        ctx.model = (native, at, engine)
        return torch.from_numpy(native.images(_on_host(phases), at, engine)).to(phases.device)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradients: torch.Tensor) -> tuple[torch.Tensor | None, None, None, None]:
        if not ctx.needs_input_grad[0]:
            return None, None, None, None
        [phases], (native, at, engine) = ctx.saved_tensors, ctx.model
        gradient = native.adjoint(_on_host(phases), at, _on_host(gradients), engine)
        return torch.from_numpy(gradient).to(phases.device, phases.dtype), None, None, None


def _on_host(tensor: torch.Tensor) -> Any:
    """Returns a tensor as an array of NumPy, without a copy if it is contiguous float32 on the host."""
    return tensor.detach().to("cpu", torch.float32).contiguous().numpy()

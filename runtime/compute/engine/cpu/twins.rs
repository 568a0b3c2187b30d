//! Maps each kernel to its CPU twin, from the table.

use super::frames::{Frame, Whole};
use super::pupil_pass::{Pass, WindowFrame};
use crate::engine::Kernel;

/// The signature of a twin, by scope.
#[derive(Clone, Copy)]
pub(super) enum Twin {
    Frames(fn(&mut Frame<'_>)),
    Windows(fn(&mut WindowFrame<'_>)),
    PupilPasses(fn(&mut Pass<'_>)),
    Whole(fn(&mut Whole<'_>)),
}

macro_rules! twins {
    ($(
        $(#[$doc:meta])*
        $kernel:ident = $name:literal {
            over: $scope:ident, group: $group:ident,
            binds: [$($access:ident $resource:ident),*],
            $(args: $args:ident: $type:ty,)?
            $(fits: $fits:expr,)?
            work: $work:expr,
            twin: $twin:expr,
            shader: $how:ident $shader:expr,
        }
    )*) => {
        const TWINS: [Twin; Kernel::ALL.len()] = [$(Twin::$scope($twin)),*];
    };
}
eyebox_kernels::kernels!(twins);

/// Returns the twin of a kernel, of the kind that its scope requires.
pub(super) fn twin(kernel: Kernel) -> Twin {
    TWINS[kernel as usize]
}

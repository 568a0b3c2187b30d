//! How each kernel's shader is run, from the table.

use super::call::Call;
use crate::engine::{EngineError, Kernel, PupilPass};
use eyebox_spirv::{Module, module};
use std::sync::LazyLock;

/// How a shader is run.
#[derive(Clone, Copy)]
pub(super) enum Shader {
    /// Once for the dispatch.
    Once(fn(&mut Call<'_, '_>) -> Result<(), EngineError>),
    /// For each of its pupil passes.
    Each(fn(&mut Call<'_, '_>, &PupilPass) -> Result<(), EngineError>),
    /// For each mode of the source in each of them.
    Modes(fn(&mut Call<'_, '_>, &PupilPass) -> Result<(), EngineError>),
}

macro_rules! shaders {
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
        /// With their modules; there is none for what the transfer queue does, and for transforms, which have several.
        static SHADERS: LazyLock<[(Shader, Option<&'static Module>); Kernel::ALL.len()]> =
            LazyLock::new(|| [$((Shader::$how($shader), module($name))),*]);
    };
}
eyebox_kernels::kernels!(shaders);

/// That of a kernel, and its module.
pub(super) fn shader(kernel: Kernel) -> (Shader, Option<&'static Module>) {
    SHADERS[kernel as usize]
}

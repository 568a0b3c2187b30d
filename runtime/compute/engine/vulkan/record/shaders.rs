//! Maps each kernel to its shader, from the table.

use super::call::Call;
use crate::engine::{EngineError, Kernel, PupilPass};
use eyebox_spirv::{Module, module};
use std::sync::LazyLock;

/// The repetition of a shader.
#[derive(Clone, Copy)]
pub(super) enum Shader {
    /// Once for each dispatch.
    Once(fn(&mut Call<'_, '_>) -> Result<(), EngineError>),
    /// Once per pupil pass of the dispatch.
    Each(fn(&mut Call<'_, '_>, &PupilPass) -> Result<(), EngineError>),
    /// Once per mode of the source in each pupil pass.
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
        /// The shaders with their modules. There is none for work of the transfer queue, nor for transforms, which
        /// have several.
        static SHADERS: LazyLock<[(Shader, Option<&'static Module>); Kernel::ALL.len()]> =
            LazyLock::new(|| [$((Shader::$how($shader), module($name))),*]);
    };
}
eyebox_kernels::kernels!(shaders);

/// Returns the shader of a kernel, and its module.
pub(super) fn shader(kernel: Kernel) -> (Shader, Option<&'static Module>) {
    SHADERS[kernel as usize]
}

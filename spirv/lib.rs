//! The compiled modules, embedded, with the manifest of their sources.
//!
//! `kernels/NAME.comp` becomes `spirv/NAME.spv`; `spirv/manifest.toml` holds the compiler's version, its flags and the
//! hashes of sources and modules. After a shader was changed: `cargo run -p eyebox-spirv-tool -- build`
//! (needs `glslangValidator` and `spirv-val`); building and running eyebox needs neither. A new module is registered
//! in one line below.

#[cfg(any(test, feature = "manifest"))]
pub mod manifest;

/// Bytes aligned as SPIR-V's words.
#[repr(C)]
struct Aligned<T: ?Sized>([u32; 0], T);

/// One compiled module.
pub struct Module {
    /// Name of its source, without `.comp`.
    pub name: &'static str,
    data: &'static Aligned<[u8]>,
}

impl Module {
    /// The module in words, as Vulkan takes it.
    pub fn words(&self) -> &'static [u32] {
        bytemuck::cast_slice(&self.data.1)
    }
}

#[cfg(feature = "modules")]
macro_rules! modules {
    ($($constant:ident = $name:literal,)*) => {
        $(
            #[doc = concat!("`kernels/", $name, ".comp`.")]
            pub static $constant: Module =
                Module { name: $name, data: &Aligned([], *include_bytes!(concat!($name, ".spv"))) };
        )*
        /// All of them.
        pub static ALL: &[&Module] = &[$(&$constant),*];
    };
}

#[cfg(feature = "modules")]
modules! {
    ADAM = "adam",
    BALANCE = "balance",
    COMPARE = "compare",
    ENERGY = "energy",
    EVEN = "even",
    EXPOSURE = "exposure",
    ENCODE = "encode",
    FFT_CHIRP = "fft_chirp",
    FFT_PASS = "fft_pass",
    FFT_ROWS = "fft_rows",
    INTENSITY = "intensity",
    MODULATE = "modulate",
    OVERLAP = "overlap",
    PASS_PUPIL = "pass_pupil",
    PHOTOGRAPH = "photograph",
    PROJECT = "project",
    QUANTISE = "quantise",
    RESAMPLE = "resample",
    RETURN_PUPIL = "return_pupil",
    TAPER = "taper",
    TRANSFER = "transfer",
    WEIGH = "weigh",
}

#[cfg(all(test, feature = "modules"))]
mod tests {
    use super::*;
    use std::path::Path;

    /// Sources, manifest, modules and the list above agree: nothing is missing, stale, orphaned or left out.
    #[test]
    fn modules_are_those_of_the_sources() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        let faults = manifest::faults(root).unwrap();
        assert!(faults.is_empty(), "{}", faults.join("\n"));
        let manifest = manifest::Manifest::read(root).unwrap();
        let mut embedded: Vec<&str> = ALL.iter().map(|m| m.name).collect();
        embedded.sort_unstable();
        let mut built: Vec<&str> = manifest.module.iter().map(|m| m.name.as_str()).collect();
        built.sort_unstable();
        assert_eq!(embedded, built, "the list in spirv/lib.rs differs from the manifest");
        for module in ALL {
            assert_eq!(module.words()[0], 0x0723_0203, "{} is no SPIR-V", module.name);
        }
    }
}

//! Embeds the compiled SPIR-V modules, with the manifest of their sources.
//!
//! `kernels/NAME.comp` becomes `spirv/NAME.spv`. `spirv/manifest.toml` holds the compiler's version, its flags and the
//! hashes of sources and modules. A shader that includes `half.glsl` gives two modules. `NAME` has complex fields in
//! float32 in memory, and `NAME_half` has them in halves.
//!
//! After a change of a shader, run `cargo run -p eyebox-spirv-tool -- build`, which needs `glslangValidator` and
//! `spirv-val`. It also writes the list of modules, `modules.rs`. Building and running eyebox needs neither tool.

#[cfg(any(test, feature = "manifest"))]
pub mod manifest;

/// Bytes with the alignment of SPIR-V words.
#[repr(C)]
struct Aligned<T: ?Sized>([u32; 0], T);

/// One compiled SPIR-V module.
pub struct Module {
    /// Name of the file, without `.spv`.
    pub name: &'static str,
    /// The module of the same shader for fields stored in halves, if the shader has such a variant.
    pub half: Option<&'static Module>,
    data: &'static Aligned<[u8]>,
}

impl Module {
    /// Returns the variant for fields stored as halves or as float32. A module without fields returns itself.
    pub fn stored(&'static self, half: bool) -> &'static Self {
        self.half.filter(|_| half).unwrap_or(self)
    }

    /// Returns the module in words, as Vulkan takes it.
    pub fn words(&self) -> &'static [u32] {
        bytemuck::cast_slice(&self.data.1)
    }
}

#[cfg(feature = "modules")]
macro_rules! modules {
    ($($constant:ident = $name:literal $(, $half:ident = $half_name:literal)?;)*) => {
        $(
            #[doc = concat!("`kernels/", $name, ".comp`.")]
            pub static $constant: Module = Module {
                name: $name,
                half: { let _half: Option<&'static Module> = None; $(let _half = Some(&$half);)? _half },
                data: &Aligned([], *include_bytes!(concat!($name, ".spv"))),
            };
            $(
                #[doc = concat!("`kernels/", $name, ".comp` with `HALF`.")]
                pub static $half: Module =
                    Module { name: $half_name, half: None, data: &Aligned([], *include_bytes!(concat!($half_name, ".spv"))) };
            )?
        )*
        /// All modules that are embedded.
        pub static ALL: &[&Module] = &[$(&$constant, $(&$half,)?)*];
    };
}

#[cfg(feature = "modules")]
include!("modules.rs");

/// Returns the module of this name, if there is one. If it has two variants, this is the one for float32.
#[cfg(feature = "modules")]
pub fn module(name: &str) -> Option<&'static Module> {
    ALL.iter().copied().find(|module| module.name == name)
}

#[cfg(all(test, feature = "modules"))]
mod tests {
    use super::*;
    use std::path::Path;

    /// Sources, manifest, modules and the list above agree. No module is missing, stale, orphaned or left out.
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

    /// A compiler may assume that no value is NaN, so kernels test for NaN by the bits of a value only.
    #[test]
    fn no_kernel_asks_whether_a_float_is_nan() {
        const IS_NAN: u32 = 156;
        const IS_INFINITE: u32 = 157;
        const ORDERED: u32 = 162;
        const UNORDERED: u32 = 163;
        // The comparisons equal, unequal, less and so on, each ordered and unordered.
        const COMPARISONS: std::ops::RangeInclusive<u32> = 180..=191;
        for module in ALL {
            let words = module.words();
            let mut at = 5;
            while at < words.len() {
                let (code, count) = (words[at] & 0xffff, (words[at] >> 16).max(1) as usize);
                assert!(![IS_NAN, IS_INFINITE, ORDERED, UNORDERED].contains(&code), "{} asks for NaN", module.name);
                if COMPARISONS.contains(&code) {
                    assert!(words[at + 3] != words[at + 4], "{} compares a value with itself", module.name);
                }
                at += count;
            }
        }
    }
}

//! Constants that programs compare and combine.

/// The version of the interface that this header describes. It rises with each change that requires programs to be
/// compiled again.
pub const EYEBOX_INTERFACE: u32 = 2;

/// The bit of red in a set of colors.
pub const EYEBOX_RED: u32 = 1;
/// The bit of green in a set of colors.
pub const EYEBOX_GREEN: u32 = 2;
/// The bit of blue in a set of colors.
pub const EYEBOX_BLUE: u32 = 4;

/// Returns the version of the library's interface. If it differs from `EYEBOX_INTERFACE`, the program was compiled for
/// another version and must not continue.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_interface() -> u32 {
    EYEBOX_INTERFACE
}

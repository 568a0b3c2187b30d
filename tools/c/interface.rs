//! What programs compare and combine.

/// The interface that this header describes. It is raised with every change that a program has to be compiled anew for.
pub const EYEBOX_INTERFACE: u32 = 2;

/// Red, as one bit of a set of colours.
pub const EYEBOX_RED: u32 = 1;
/// Green.
pub const EYEBOX_GREEN: u32 = 2;
/// Blue.
pub const EYEBOX_BLUE: u32 = 4;

/// The interface that the library has: a program that was compiled for another one (EYEBOX_INTERFACE) must not go on.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_interface() -> u32 {
    EYEBOX_INTERFACE
}

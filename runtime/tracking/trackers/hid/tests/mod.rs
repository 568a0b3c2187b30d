//! Builds descriptors and reports by hand after the HID usage tables. None comes from a device.

mod decoding;
mod descriptors;
mod fuzz;
mod plugging;
#[cfg(target_os = "linux")]
mod uhid;

/// A report descriptor under construction, with the item names of the specification.
#[derive(Default, Clone)]
pub struct Build(pub Vec<u8>);

impl Build {
    fn item(mut self, prefix: u8, value: i64) -> Self {
        let size = match value {
            -128..=127 => 1,
            -32768..=32767 => 2,
            _ => 4,
        };
        self.0.push(prefix | [0, 1, 2, 0, 3][size]);
        self.0.extend(&value.to_le_bytes()[..size]);
        self
    }

    pub fn page(self, v: i64) -> Self {
        self.item(0x04, v)
    }

    pub fn usage(self, v: i64) -> Self {
        self.item(0x08, v)
    }

    pub fn logical(self, low: i64, high: i64) -> Self {
        self.item(0x14, low).item(0x24, high)
    }

    pub fn physical(self, low: i64, high: i64) -> Self {
        self.item(0x34, low).item(0x44, high)
    }

    /// The unit's code, and its exponent as four bits.
    pub fn unit(self, code: i64, exponent: i64) -> Self {
        self.item(0x64, code).item(0x54, exponent & 0xf)
    }

    pub fn size(self, bits: i64, count: i64) -> Self {
        self.item(0x74, bits).item(0x94, count)
    }

    pub fn id(self, v: i64) -> Self {
        self.item(0x84, v)
    }

    pub fn input(self, flags: i64) -> Self {
        self.item(0x80, flags)
    }

    pub fn feature(self, flags: i64) -> Self {
        self.item(0xb0, flags)
    }

    pub fn push(mut self) -> Self {
        self.0.push(0xa4);
        self
    }

    pub fn pop(mut self) -> Self {
        self.0.push(0xb4);
        self
    }

    pub fn open(self, kind: i64) -> Self {
        self.item(0xa0, kind)
    }

    pub fn close(mut self) -> Self {
        self.0.push(0xc0);
        self
    }

    /// A physical collection with this number of axes of 32 bits, flagged constant and variable.
    pub fn position(self, usage: i64, axes: i64) -> Self {
        let named = (0..axes).fold(self.usage(usage).open(0).size(32, axes), |b, i| b.usage(0x21 + i));
        named.input(3).close()
    }
}

pub const MICROMETRES: (i64, i64) = (0x11, -4);
pub const MICROSECONDS: (i64, i64) = (0x1001, -6);
pub const HERTZ: (i64, i64) = (0xf001, 0);

/// An eye tracker as in HUTRR74. It has a time of eight bytes, gaze point, both eyes, reserved fields, status and mode.
pub fn tracker() -> Vec<u8> {
    Build::default()
        .page(0x12)
        .usage(0x01)
        .open(1)
        .usage(0x10)
        .open(2)
        .id(0x10)
        .logical(0, 255)
        .usage(0x20)
        .unit(MICROSECONDS.0, MICROSECONDS.1)
        .size(8, 8)
        .input(2)
        .unit(MICROMETRES.0, MICROMETRES.1)
        .logical(-2_000_000, 2_000_000)
        .position(0x24, 2)
        .position(0x25, 3)
        .position(0x26, 3)
        .size(32, 6)
        .input(3)
        .close()
        .usage(0x13)
        .open(2)
        .id(0x13)
        .unit(0, 0)
        .logical(0, 4)
        .size(8, 1)
        .usage(0x301)
        .feature(2)
        .unit(HERTZ.0, HERTZ.1)
        .logical(0, 65535)
        .size(16, 1)
        .usage(0x300)
        .feature(2)
        .close()
        .usage(0x13)
        .open(2)
        .id(0x13)
        .unit(0, 0)
        .logical(0, 4)
        .size(8, 1)
        .usage(0x301)
        .input(2)
        .close()
        .usage(0x14)
        .open(2)
        .id(0x14)
        .logical(0, 7)
        .size(8, 1)
        .usage(0x400)
        .feature(2)
        .close()
        .close()
        .0
}

/// A report of [`tracker`] with time in microseconds, then gaze, left eye and right eye in micrometers.
pub fn report(time_us: u64, positions: [i32; 8]) -> Vec<u8> {
    let mut out = vec![0x10];
    out.extend(time_us.to_le_bytes());
    positions.iter().for_each(|p| out.extend(p.to_le_bytes()));
    out.extend([0; 24]);
    out
}

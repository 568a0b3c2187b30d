//! Names usages and units of HID for people.

use super::descriptor::Usage;

/// The page of eye and head trackers (HUTRR74).
pub const EYE_PAGE: u16 = 0x12;

/// The name of a usage page.
fn page(page: u16) -> Option<&'static str> {
    Some(match page {
        0x01 => "Generic Desktop",
        0x02 => "Simulation Controls",
        0x03 => "VR Controls",
        0x05 => "Game Controls",
        0x06 => "Generic Device Controls",
        0x07 => "Keyboard",
        0x08 => "LED",
        0x09 => "Button",
        0x0c => "Consumer",
        0x0d => "Digitizers",
        0x0e => "Haptics",
        EYE_PAGE => "Eye and Head Trackers",
        0x20 => "Sensors",
        0x84 => "Power",
        0x85 => "Battery",
        0xff00.. => "Vendor-defined",
        _ => return None,
    })
}

/// The name of a usage of page 0x12, or of the few others that its neighbors use.
fn name(usage: Usage) -> Option<&'static str> {
    Some(match (usage.page, usage.id) {
        (EYE_PAGE, id) => match id {
            0x01 => "Eye Tracker",
            0x02 => "Head Tracker",
            0x10 => "Tracking Data",
            0x11 => "Capabilities",
            0x12 => "Configuration",
            0x13 => "Status",
            0x14 => "Control",
            0x20 => "Sensor Timestamp",
            0x21 => "Position X",
            0x22 => "Position Y",
            0x23 => "Position Z",
            0x24 => "Gaze Point",
            0x25 => "Left Eye Position",
            0x26 => "Right Eye Position",
            0x27 => "Head Position",
            0x28 => "Head Direction Point",
            0x29 => "Rotation about X axis",
            0x2a => "Rotation about Y axis",
            0x2b => "Rotation about Z axis",
            0x100 => "Tracker Quality",
            0x101 => "Minimum Tracking Distance",
            0x102 => "Optimum Tracking Distance",
            0x103 => "Maximum Tracking Distance",
            0x104 => "Maximum Screen Plane Width",
            0x105 => "Maximum Screen Plane Height",
            0x200 => "Display Manufacturer ID",
            0x201 => "Display Product ID",
            0x202 => "Display Serial Number",
            0x203 => "Display Manufacturer Date",
            0x204 => "Calibrated Screen Width",
            0x205 => "Calibrated Screen Height",
            0x300 => "Sampling Frequency",
            0x301 => "Configuration Status",
            0x400 => "Device Mode Request",
            _ => return None,
        },
        (0x01, 0x01) => "Pointer",
        (0x01, 0x02) => "Mouse",
        (0x01, 0x04) => "Joystick",
        (0x01, 0x05) => "Game Pad",
        (0x01, 0x06) => "Keyboard",
        (0x01, 0x30) => "X",
        (0x01, 0x31) => "Y",
        (0x01, 0x32) => "Z",
        (0x01, 0x38) => "Wheel",
        (0x01, 0x80) => "System Control",
        (0x0c, 0x01) => "Consumer Control",
        (0x0d, 0x01) => "Digitizer",
        (0x0d, 0x02) => "Pen",
        (0x0d, 0x04) => "Touch Screen",
        (0x0d, 0x05) => "Touch Pad",
        (0x0d, 0x0e) => "Device Configuration",
        (0x0d, 0x20) => "Stylus",
        (0x0d, 0x22) => "Finger",
        (0x0d, 0x30) => "Tip Pressure",
        (0x0d, 0x32) => "In Range",
        (0x0d, 0x42) => "Tip Switch",
        (0x0d, 0x47) => "Touch Valid",
        (0x0d, 0x51) => "Contact Identifier",
        (0x0d, 0x54) => "Contact Count",
        (0x0d, 0x55) => "Contact Count Maximum",
        _ => return None,
    })
}

/// The name of a usage for people, or its numbers with the page's name.
pub fn usage_name(usage: Usage) -> String {
    match (name(usage), page(usage.page)) {
        (Some(name), _) => name.into(),
        (None, Some(page)) => format!("{page} 0x{:02x}", usage.id),
        (None, None) => format!("0x{:04x}:0x{:02x}", usage.page, usage.id),
    }
}

/// The kind of a collection for people.
pub fn collection_kind(kind: u8) -> &'static str {
    let kinds = ["physical", "application", "logical", "report", "named array", "usage switch", "usage modifier"];
    kinds.get(usize::from(kind)).unwrap_or(&"other")
}

/// The meaning of a unit code and its exponent.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Dimension {
    /// A number without a unit.
    None,
    /// A length, in meters per count.
    Length(f64),
    /// An angle, in radians per count.
    Angle(f64),
    /// A time, in seconds per count.
    Time(f64),
    /// A frequency, in hertz per count.
    Frequency(f64),
    /// A quantity that eyebox does not use.
    Other,
}

/// Reads a HID unit. Four bits give the system. Four more bits in two's complement give each power of length, mass,
/// time, temperature, current and luminous intensity.
pub fn dimension(unit: u32, exponent: i32) -> Dimension {
    let power = |place: u32| ((unit >> (4 * place) & 0xf) as i32 ^ 8) - 8;
    let powers: [i32; 6] = std::array::from_fn(|i| power(i as u32 + 1));
    let ten = 10f64.powi(exponent);
    match (unit & 0xf, powers) {
        (0, _) => Dimension::None,
        (1, [1, 0, 0, 0, 0, 0]) => Dimension::Length(1e-2 * ten),
        (3, [1, 0, 0, 0, 0, 0]) => Dimension::Length(2.54e-2 * ten),
        (2, [1, 0, 0, 0, 0, 0]) => Dimension::Angle(ten),
        (4, [1, 0, 0, 0, 0, 0]) => Dimension::Angle(ten.to_radians()),
        (1..=4, [0, 0, 1, 0, 0, 0]) => Dimension::Time(ten),
        (1..=4, [0, 0, -1, 0, 0, 0]) => Dimension::Frequency(ten),
        _ => Dimension::Other,
    }
}

/// The name of a unit for people, such as `um`, `us` or `Hz`, and empty without a unit.
pub fn unit_name(unit: u32, exponent: i32) -> String {
    let prefixed = |scale: f64, base: &str| {
        let power = scale.log10().round() as i32;
        let exact = (scale / 10f64.powi(power) - 1.0).abs() < 1e-9;
        match (exact, power) {
            (true, 0) => base.into(),
            (true, -2) if base == "m" => "cm".into(),
            (true, -3) => format!("m{base}"),
            (true, -6) => format!("u{base}"),
            (true, -9) => format!("n{base}"),
            (true, 3) => format!("k{base}"),
            (true, _) => format!("1e{power} {base}"),
            _ => format!("{scale:.4e} {base}"),
        }
    };
    match dimension(unit, exponent) {
        Dimension::None if exponent == 0 => String::new(),
        Dimension::None => format!("1e{exponent}"),
        Dimension::Length(scale) if unit & 0xf == 1 => prefixed(scale, "m"),
        Dimension::Length(_) => prefixed(10f64.powi(exponent), "in"),
        Dimension::Angle(_) if unit & 0xf == 4 => prefixed(10f64.powi(exponent), "deg"),
        Dimension::Angle(scale) => prefixed(scale, "rad"),
        Dimension::Time(scale) => prefixed(scale, "s"),
        Dimension::Frequency(scale) => prefixed(scale, "Hz"),
        Dimension::Other => format!("unit 0x{unit:x} 1e{exponent}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_read_as_the_specification_writes_them() {
        // The linear SI unit is the centimeter, so 1e-4 cm is a micrometer.
        assert_eq!(unit_name(0x11, -4), "um");
        assert_eq!(unit_name(0x1001, -6), "us");
        assert_eq!(unit_name(0xf001, 0), "Hz");
        assert_eq!(unit_name(0x11, 0), "cm");
        assert_eq!(unit_name(0x13, -3), "min");
        assert_eq!(unit_name(0x14, 0), "deg");
        assert_eq!(unit_name(0, 0), "");
        let Dimension::Length(inch) = dimension(0x13, 0) else { panic!() };
        assert!((inch - 0.0254).abs() < 1e-15);
        assert_eq!(dimension(0x0110_0101, 0), Dimension::Other);
    }
}

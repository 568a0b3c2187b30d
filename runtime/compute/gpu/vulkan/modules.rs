//! Changes SPIR-V modules before a driver compiles them, instruction by instruction.

use ash::vk;

/// Returns the instructions after the header, each with its index, its opcode and its words.
pub(super) fn instructions(words: &[u32]) -> impl Iterator<Item = (usize, u32, &[u32])> {
    let mut at = 5;
    std::iter::from_fn(move || {
        let first = *words.get(at)?;
        let instruction = words.get(at..at + (first >> 16).max(1) as usize)?;
        at += instruction.len();
        Some((at - instruction.len(), first & 0xffff, instruction))
    })
}

/// Constant of a module with halves. It is true if the device keeps subnormal halves when it unpacks them. See
/// `half.glsl`.
const PRESERVES_HALVES: u32 = 100;
/// Constant of such a module. It is true if the device rounds to nearest when it packs halves, and passed the test of
/// that.
const ROUNDS_HALVES: u32 = 101;

/// A module whose `main` returns at once, in SPIR-V 1.0. It has the header, capability `Shader`, memory model, entry
/// point, one lane per workgroup, and the function.
#[rustfmt::skip]
pub(super) const NOTHING: [u32; 35] = [
    0x0723_0203, 0x0001_0000, 0, 5, 0,
    op(2, 17), 1,
    op(3, 14), 0, 1,
    op(5, 15), 5, 1, u32::from_le_bytes(*b"main"), 0,
    op(6, 16), 1, 17, 1, 1, 1,
    op(2, 19), 2,
    op(3, 33), 3, 2,
    op(5, 54), 2, 1, 0, 3,
    op(2, 248), 4,
    op(1, 253),
    op(1, 56),
];

/// Returns the first word of an instruction of `words` words.
const fn op(words: u32, code: u32) -> u32 {
    words << 16 | code
}

/// The float behavior of a device, as far as modules can set it, as capabilities, execution modes and widths.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct FloatModes {
    modes: Vec<(u32, u32, u32)>,
    /// True if subnormal halves are kept.
    preserves_halves: bool,
    /// True if halves are rounded to nearest. The test of the device shows if subnormal ones are kept.
    pub(super) rounds_halves: bool,
}

impl FloatModes {
    /// Returns the modes for a device. They set rounding of float32 to nearest, on which pairs of float32 rely. They
    /// forbid the assumption that no value is NaN, on which losses rely. They keep subnormal halves.
    pub(super) fn of(controls: &vk::PhysicalDeviceFloatControlsProperties<'_>) -> Self {
        use vk::ShaderFloatControlsIndependence as Independence;
        const PRESERVE_SUBNORMAL: (u32, u32) = (4464, 4459);
        const PRESERVE_NAN: (u32, u32) = (4466, 4461);
        const ROUND_TO_NEAREST: (u32, u32) = (4467, 4462);
        let mut modes = Vec::new();
        let mut add = |(capability, mode), width| modes.push((capability, mode, width));
        if controls.shader_signed_zero_inf_nan_preserve_float32 == vk::TRUE {
            add(PRESERVE_NAN, 32);
        }
        if controls.shader_rounding_mode_rte_float32 == vk::TRUE
            && controls.rounding_mode_independence != Independence::NONE
        {
            add(ROUND_TO_NEAREST, 32);
        }
        // Widths of halves alone, or with float64. On some devices, both must have the same setting.
        let widths = |independence, of_16, of_64| match independence {
            Independence::ALL if of_16 == vk::TRUE => &[16][..],
            Independence::TYPE_32_ONLY if of_16 == vk::TRUE && of_64 == vk::TRUE => &[16, 64],
            _ => &[],
        };
        let kept = widths(
            controls.denorm_behavior_independence,
            controls.shader_denorm_preserve_float16,
            controls.shader_denorm_preserve_float64,
        );
        let rounded = widths(
            controls.rounding_mode_independence,
            controls.shader_rounding_mode_rte_float16,
            controls.shader_rounding_mode_rte_float64,
        );
        kept.iter().for_each(|width| add(PRESERVE_SUBNORMAL, *width));
        rounded.iter().for_each(|width| add(ROUND_TO_NEAREST, *width));
        Self { modes, preserves_halves: !kept.is_empty(), rounds_halves: !rounded.is_empty() }
    }

    /// Returns the specialization constants 0, 1, ... of a module, with the constants that describe the device.
    pub(super) fn specialised(&self, constants: &[u32]) -> (Vec<vk::SpecializationMapEntry>, Vec<u32>) {
        let ids = (0..constants.len() as u32).chain([PRESERVES_HALVES, ROUNDS_HALVES]).zip(0..);
        let entries =
            ids.map(|(id, i)| vk::SpecializationMapEntry { constant_id: id, offset: 4 * i, size: 4 }).collect();
        (entries, constants.iter().copied().chain([self.preserves_halves, self.rounds_halves].map(u32::from)).collect())
    }

    /// Returns the module with the modes of this device.
    pub(super) fn put_into(&self, words: &[u32]) -> Vec<u32> {
        const CAPABILITY: u32 = 17;
        const ENTRY_POINT: u32 = 15;
        const EXECUTION_MODE: u32 = 16;
        let mut capabilities: Vec<u32> = self.modes.iter().map(|mode| mode.0).collect();
        capabilities.sort_unstable();
        capabilities.dedup();
        let mut made = words.get(..5).unwrap_or_default().to_vec();
        for (_, code, instruction) in instructions(words) {
            made.extend(instruction);
            if code == CAPABILITY {
                made.extend(capabilities.drain(..).flat_map(|capability| [2 << 16 | CAPABILITY, capability]));
            }
            if code == ENTRY_POINT {
                let entry = instruction[2];
                made.extend(
                    self.modes.iter().flat_map(|&(_, mode, width)| [4 << 16 | EXECUTION_MODE, entry, mode, width]),
                );
            }
        }
        made
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Modes are at their place in modules, and only modes that the device lets a module choose.
    #[test]
    fn modules_ask_for_what_a_device_offers() {
        use vk::ShaderFloatControlsIndependence as Independence;
        let words = eyebox_spirv::TRANSFER.words();
        assert_eq!(FloatModes::of(&Default::default()).put_into(words), words);
        let mut controls = vk::PhysicalDeviceFloatControlsProperties::default()
            .shader_signed_zero_inf_nan_preserve_float32(true)
            .shader_rounding_mode_rte_float32(true)
            .shader_denorm_preserve_float16(true)
            .rounding_mode_independence(Independence::TYPE_32_ONLY)
            .denorm_behavior_independence(Independence::TYPE_32_ONLY);
        // There halves cannot be kept alone, but only together with float64.
        assert!(!FloatModes::of(&controls).preserves_halves);
        controls.shader_denorm_preserve_float64 = vk::TRUE;
        let modes = FloatModes::of(&controls);
        let made = modes.put_into(words);
        let of =
            |wanted| instructions(&made).filter(move |(_, code, _)| *code == wanted).map(|(.., words)| &words[1..]);
        let capabilities: Vec<u32> = of(17).map(|capability| capability[0]).collect();
        assert_eq!(capabilities, [1, 4464, 4466, 4467]);
        let asked: Vec<&[u32]> = of(16).map(|mode| &mode[1..]).filter(|mode| mode[0] > 4000).collect();
        assert_eq!(asked, [[4461, 32], [4462, 32], [4459, 16], [4459, 64]]);
        assert_eq!(made.len(), words.len() + 3 * 2 + 4 * 4);
        assert_eq!(modes.specialised(&[7]).1, [7, 1, 0]);
        // The same holds for their rounding, with float64 and alone.
        let asked = |controls| {
            let modes = FloatModes::of(&controls);
            (modes.specialised(&[]).1, modes.modes.into_iter().filter(|m| m.1 == 4462).map(|m| m.2).collect::<Vec<_>>())
        };
        controls.shader_rounding_mode_rte_float16 = vk::TRUE;
        assert_eq!(asked(controls), (vec![1, 0], vec![32]));
        controls.shader_rounding_mode_rte_float64 = vk::TRUE;
        assert_eq!(asked(controls), (vec![1, 1], vec![32, 16, 64]));
        controls.rounding_mode_independence = Independence::ALL;
        assert_eq!(asked(controls), (vec![1, 1], vec![32, 16]));
        // Parts of a module have an order, with no capability after the entry point and no mode before it.
        let at = |wanted: u32| instructions(&made).position(|(_, code, _)| code == wanted).unwrap();
        assert!(at(17) < at(15) && at(15) < at(16));
    }
}

//! What is changed of a module before a driver takes it: words of SPIR-V, instruction by instruction.

use ash::vk;

/// The instructions behind the header: where each begins, its code, its words.
pub(super) fn instructions(words: &[u32]) -> impl Iterator<Item = (usize, u32, &[u32])> {
    let mut at = 5;
    std::iter::from_fn(move || {
        let first = *words.get(at)?;
        let instruction = words.get(at..at + (first >> 16).max(1) as usize)?;
        at += instruction.len();
        Some((at - instruction.len(), first & 0xffff, instruction))
    })
}

/// Says, of a module with halves, that its device keeps halves that are subnormal when it unpacks them: see `half.glsl`.
pub(super) const PRESERVES_HALVES: u32 = 100;

/// How a device is to compute with floats, as far as it lets modules say so: capabilities, execution modes and widths.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct FloatModes {
    modes: Vec<(u32, u32, u32)>,
    /// Whether subnormal halves are kept.
    pub(super) preserves_halves: bool,
}

impl FloatModes {
    /// Rounding of float32 to the nearest, on which pairs of them rely; no assumption that nothing is NaN, on which losses
    /// rely; subnormal halves kept.
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
        let alone = controls.denorm_behavior_independence == Independence::ALL;
        let with_64 = controls.denorm_behavior_independence == Independence::TYPE_32_ONLY
            && controls.shader_denorm_preserve_float64 == vk::TRUE;
        let preserves_halves = controls.shader_denorm_preserve_float16 == vk::TRUE && (alone || with_64);
        if preserves_halves {
            add(PRESERVE_SUBNORMAL, 16);
            // What is said of one of them is said of both.
            if !alone {
                add(PRESERVE_SUBNORMAL, 64);
            }
        }
        Self { modes, preserves_halves }
    }

    /// The module, for such a device.
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

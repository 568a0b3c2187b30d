//! Encoding allocates no memory in its steady state.

use eyebox::low_level::encode::{Encoder, PhaseSet};
use eyebox::low_level::optics::{Color, Display};
use eyebox_tests::pool;

#[test]
fn encoding_a_set_allocates_nothing() {
    for preset in ["grey8", "fields", "planes8", "planes24", "plm"] {
        let display = Display { height: 120, width: 300, ..Display::preset(preset).expect("a preset") };
        let encoder = Encoder::new(&display, &[Color::Red, Color::Green, Color::Blue], 8).expect("an encoder");
        let phases: Vec<Vec<f32>> = (0..3).map(|c| (0..8 * 36_000).map(|i| (i * c) as f32 * 1e-3).collect()).collect();
        let slices: Vec<&[f32]> = phases.iter().map(|p| &p[..]).collect();
        let mut frames = encoder.frames();
        // One thread, so the counter sees all allocations.
        let counted = pool(1).install(|| {
            allocation_counter::measure(|| {
                for _ in 0..20 {
                    let set = PhaseSet::new(&slices, encoder.hologram_size()).expect("phases");
                    encoder.encode_into(&set, &mut frames).expect("encoded");
                }
            })
        });
        assert_eq!(counted.count_total, 0, "{preset}");
    }
}

//! The steady state of encoding: nothing is allocated.

use eyebox::low_level::encode::{Encoder, PhaseSet};
use eyebox::low_level::optics::{Color, Display};
use eyebox_tests::pool;

#[test]
fn encoding_a_set_allocates_nothing() {
    let all = [Color::Red, Color::Green, Color::Blue];
    for (preset, colors) in [
        ("grey8", &all[..]),
        ("fields", &all),
        ("planes8", &all),
        ("planes24", &all),
        ("plm", &all),
        ("hamamatsu-x15213", &all),
        ("meadowlark-hdmi-10bit", &all[1..2]),
    ] {
        let display = Display { height: 120, width: 300, ..Display::preset(preset).expect("a preset") };
        let encoder = Encoder::new(&display, colors, 8).expect("an encoder");
        let phases: Vec<Vec<f32>> =
            (0..colors.len()).map(|c| (0..8 * 36_000).map(|i| (i * c) as f32 * 1e-3).collect()).collect();
        let slices: Vec<&[f32]> = phases.iter().map(|p| &p[..]).collect();
        let mut frames = encoder.frames();
        // One thread, so that all that is done is counted.
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

//! Prints `eyebox info` of a tracker's recording.

use crate::Failure;
use crate::talk::print_report;
use eyebox::low_level::trackers::{Event, Options, Sample, Spec, open};
use serde_json::json;
use std::time::Duration;

/// Reads a whole recording and prints its contents.
pub fn run(file: &str, as_json: bool) -> Result<(), Failure> {
    let spec: Spec = file.parse()?;
    let mut source = open(&spec, &Options { real_time: false, ..Options::default() })?;
    let about = source.about().clone();
    let (mut samples, mut valid, mut first, mut last) = (0_u64, 0_u64, None, 0_u64);
    let mut eyes = [0_u64; 3];
    loop {
        match source.next(Duration::ZERO)? {
            Event::Sample(sample, _) => {
                samples += 1;
                valid += u64::from(sample.valid());
                let Sample { left, right, combined, .. } = &sample;
                for (count, eye) in eyes.iter_mut().zip([left, right, combined]) {
                    *count += u64::from(eye.is_some_and(|eye| eye.valid));
                }
                first.get_or_insert(sample.time_ns);
                last = last.max(sample.time_ns);
            }
            Event::End => break,
            _ => {}
        }
    }
    let seconds = last.saturating_sub(first.unwrap_or(last)) as f64 * 1e-9;
    let rate = if seconds > 0.0 { (samples.saturating_sub(1)) as f64 / seconds } else { 0.0 };
    let tracker = source.tracker();
    let [left, right, combined] = eyes;
    if as_json {
        print_report(json!({
            "kind": "recording", "tracker": tracker, "samples": samples, "valid_samples": valid, "seconds": seconds, "rate_hz": rate,
            "left": left, "right": right, "combined": combined, "notes": about.notes,
        }));
        return Ok(());
    }
    println!("{file}: a recording of {}", tracker.unwrap_or_else(|| "a tracker without a name".into()));
    println!("  samples     {samples} in {seconds:.2} s, {rate:.1} per second; {valid} valid");
    println!("  eyes        left {left}, right {right}, both {combined}");
    about.notes.iter().for_each(|note| println!("  note        {note}"));
    Ok(())
}

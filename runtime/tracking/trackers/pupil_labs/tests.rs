//! Tests the source with a peer on loopback that behaves as Pupil Core does, and with one that does not.

use super::zmtp::{Arrival, Frames, frame, greeting, ready};
use super::*;
use proptest::prelude::*;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::thread::JoinHandle;

/// A hand-made datum as Pupil writes it, which is a map of short strings, arrays and floats.
fn datum(id: u8, x: f64, confidence: f64, time: f64, diameter: Option<f64>) -> Vec<u8> {
    let text = |out: &mut Vec<u8>, t: &str| {
        out.push(0xa0 | t.len() as u8);
        out.extend(t.as_bytes());
    };
    let float = |out: &mut Vec<u8>, v: f64| {
        out.push(0xcb);
        out.extend(v.to_be_bytes());
    };
    let mut out = vec![0x80 | (6 + u8::from(diameter.is_some()))];
    text(&mut out, "topic");
    text(&mut out, "pupil");
    text(&mut out, "id");
    out.push(id);
    text(&mut out, "confidence");
    float(&mut out, confidence);
    text(&mut out, "norm_pos");
    out.push(0x92);
    float(&mut out, x);
    float(&mut out, 0.25);
    text(&mut out, "ellipse");
    out.extend([0x81, 0xa1, b'a', 0xc3]);
    text(&mut out, "timestamp");
    float(&mut out, time);
    if let Some(d) = diameter {
        text(&mut out, "diameter_3d");
        float(&mut out, d);
    }
    out
}

fn shake(stream: &mut TcpStream, socket: &str) {
    stream.write_all(&greeting()).unwrap();
    let mut theirs = [0; 64];
    stream.read_exact(&mut theirs).unwrap();
    assert_eq!((theirs[0], theirs[9], theirs[10], &theirs[12..16]), (0xff, 0x7f, 3, &b"NULL"[..]));
    stream.write_all(&ready(socket)).unwrap();
    let mut head = [0; 2];
    stream.read_exact(&mut head).unwrap();
    assert_eq!(head[0], 4, "a command");
    let mut body = vec![0; usize::from(head[1])];
    stream.read_exact(&mut body).unwrap();
    assert!(body.starts_with(b"\x05READY\x0bSocket-Type\0\0\0\x03"), "{body:?}");
}

/// Pupil Remote and a publisher of `messages`. It ends when its peer goes. Its clock runs `ahead` nanoseconds ahead.
fn peer(messages: Vec<Vec<u8>>, ahead: i64) -> (u16, JoinHandle<()>) {
    let remote = TcpListener::bind("127.0.0.1:0").unwrap();
    let data = TcpListener::bind("127.0.0.1:0").unwrap();
    let (port, data_port) = (remote.local_addr().unwrap().port(), data.local_addr().unwrap().port());
    let publisher = std::thread::spawn(move || {
        let (mut stream, _) = data.accept().unwrap();
        shake(&mut stream, "PUB");
        let mut message = [0; 9];
        stream.read_exact(&mut message).unwrap();
        assert_eq!(&message, b"\0\x07\x01pupil.");
        stream.write_all(&frame(b"\x04PING\0\0abc", 4)).unwrap();
        let mut pong = [0; 10];
        stream.read_exact(&mut pong).unwrap();
        assert_eq!(&pong, b"\x04\x08\x04PONGabc");
        for message in messages {
            if stream.write_all(&message).is_err() {
                return;
            }
        }
    });
    let handle = std::thread::spawn(move || {
        let (mut stream, _) = remote.accept().unwrap();
        shake(&mut stream, "REP");
        let mut frames = Frames::default();
        let mut bytes = [0; 512];
        while let Ok(n @ 1..) = stream.read(&mut bytes) {
            frames.push(&bytes[..n]);
            while let Some(Arrival::Message(parts)) = frames.next().unwrap() {
                let answer = match &parts[1][..] {
                    b"SUB_PORT" => data_port.to_string(),
                    b"t" => format!("{:.9}", (now_ns() as i64 + ahead) as f64 * 1e-9),
                    other => panic!("{other:?}"),
                };
                stream.write_all(&[frame(b"", 1), frame(answer.as_bytes(), 0)].concat()).unwrap();
            }
        }
        publisher.join().unwrap();
    });
    (port, handle)
}

fn message(topic: &str, payload: &[u8]) -> Vec<u8> {
    [frame(topic.as_bytes(), 1), frame(payload, 0)].concat()
}

fn samples(source: &mut PupilCoreSource, most: usize) -> (Vec<Sample>, Vec<String>) {
    let (mut samples, mut notes) = (Vec::new(), Vec::new());
    for _ in 0..100_000 {
        match source.next(Duration::from_millis(20)).unwrap() {
            Event::Sample(sample, _) => samples.push(sample),
            Event::Note(note) => notes.push(note),
            _ => {}
        }
        if samples.len() == most || notes.len() > 1 && source.link.is_none() {
            break;
        }
    }
    (samples, notes)
}

/// Pupil's clock may begin anywhere. Its maintainers allow it to be below zero, and a public recording begins at
/// -323801 s.
#[test]
fn both_eyes_arrive_with_steady_times() {
    for ahead_s in [777, 0, -323_801, -1, -1_000_000_000, 1_690_000_000, 3600, -3600, 86_400, -40] {
        both_eyes_arrive(ahead_s * 1_000_000_000);
    }
}

fn both_eyes_arrive(ahead: i64) {
    let seconds = |ns: i64| ns as f64 * 1e-9;
    let seen = now_ns() as i64 - 30_000_000;
    let later = seen + 8_000_000;
    let messages = vec![
        message("pupil.0.3d", &datum(0, 0.75, 0.9, seconds(seen + ahead), Some(3.5))),
        // The same picture in 2D is ignored. Then come the other eye and the next picture.
        message("pupil.0.2d", &datum(0, 0.1, 0.9, seconds(seen + ahead), None)),
        message("pupil.1.3d", &datum(1, 0.5, 0.0, seconds(seen + ahead), Some(3.0))),
        message("pupil.0.3d", &datum(0, 0.76, 0.9, seconds(later + ahead), Some(3.5))),
        message("pupil.1.3d", &datum(1, 0.51, 0.8, seconds(later + ahead), Some(3.0))),
    ];
    let (port, handle) = peer(messages, ahead);
    let mut source = PupilCoreSource::new("127.0.0.1", port, 0);
    let (samples, notes) = samples(&mut source, 3);
    drop(source);
    handle.join().unwrap();
    assert!(notes[0].contains(&port.to_string()), "{notes:?}");
    let first = samples[0].right.unwrap();
    assert_eq!((first.position, first.unit, first.valid), ([0.75, 0.75], Unit::Normalized, true));
    assert!((first.diameter.unwrap() - 3.5e-3).abs() < 1e-12 && first.confidence == 0.9);
    // A round trip on one machine takes far less than 10 ms, so the clocks agree to that.
    assert!(samples[0].time_ns.abs_diff(seen as u64) < 10_000_000, "{} for {seen}", samples[0].time_ns);
    assert!(!samples[1].left.unwrap().valid, "no confidence");
    let both = samples[2];
    assert_eq!(both.left.unwrap().position, [0.51, 0.75]);
    assert_eq!(both.right.unwrap().position, [0.76, 0.75]);
    assert!(both.time_ns > samples[0].time_ns && both.time_ns <= both.received_ns);
}

#[test]
fn ten_thousand_messages_of_nonsense_are_survived() {
    let good = message("pupil.1.3d", &datum(1, 0.5, 1.0, 1.0, Some(3.0)));
    let mut rng = fastrand::Rng::with_seed(9);
    let mut messages = Vec::new();
    for i in 0..10_000 {
        let mut payload = datum(0, 0.5, 1.0, 1.0, None);
        match i % 4 {
            0 => payload.truncate(rng.usize(0..payload.len())),
            1 => payload = (0..rng.usize(0..300)).map(|_| rng.u8(..)).collect(),
            2 => payload = vec![0x91; 2000], // nested arrays without end
            _ => payload = datum(rng.u8(2..), f64::NAN, f64::INFINITY, -1.0, None),
        }
        messages.push(if i % 5 == 0 { frame(&payload, 0) } else { message("pupil.0", &payload) });
    }
    messages.push(good);
    let (port, handle) = peer(messages, 0);
    let mut source = PupilCoreSource::new("127.0.0.1", port, 0);
    let (samples, notes) = samples(&mut source, 1);
    assert!(source.wrong.count >= 9_900, "{}", source.wrong.count);
    drop(source);
    handle.join().unwrap();
    assert_eq!(samples[0].left.unwrap().position, [0.5, 0.75]);
    assert!(notes.len() < 60, "one line a second: {}", notes.len());
}

#[test]
fn a_peer_that_breaks_the_protocol_is_given_up_and_nobody_is_waited_for() {
    let (port, handle) = peer(vec![frame(&[0; 10], 0xf8)], 0);
    let mut source = PupilCoreSource::new("127.0.0.1", port, 0);
    let (none, notes) = samples(&mut source, 1);
    assert!(none.is_empty() && notes[1].contains("flags 0xf8"), "{notes:?}");
    drop(source);
    handle.join().unwrap();

    // No peer listens there any more.
    let mut source = PupilCoreSource::new("127.0.0.1", port, 0);
    assert!(matches!(source.next(Duration::ZERO).unwrap(), Event::Note(_)));
    assert_eq!(source.next(Duration::ZERO).unwrap(), Event::Nothing, "said once");
}

#[test]
fn a_message_may_come_in_pieces_and_is_bounded() {
    let long = vec![7; 300];
    let bytes = [frame(b"a", 1), frame(&long, 1), frame(b"", 0), frame(b"x", 4)].concat();
    let mut frames = Frames::default();
    let mut arrivals = Vec::new();
    for byte in &bytes {
        frames.push(&[*byte]);
        arrivals.extend(frames.next().unwrap());
    }
    assert_eq!(arrivals, [Arrival::Message(vec![b"a".to_vec(), long, vec![]]), Arrival::Command(b"x".to_vec())]);
    let mut huge = Frames::default();
    huge.push(&[2, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff]);
    assert!(huge.next().is_err());
    let mut many = Frames::default();
    many.push(&frame(b"", 1).repeat(17));
    assert!(many.next().is_err());
}

proptest! {
    #[test]
    fn no_stream_of_bytes_does_harm(bytes in prop::collection::vec(any::<u8>(), 0..400), cut in 1usize..50) {
        let mut frames = Frames::default();
        'all: for piece in bytes.chunks(cut) {
            frames.push(piece);
            loop {
                match frames.next() {
                    Ok(Some(_)) => {}
                    Ok(None) => break,
                    Err(_) => break 'all,
                }
            }
        }
    }

    #[test]
    fn no_payload_does_harm(payload in prop::collection::vec(any::<u8>(), 0..200), flip in 0usize..90, to in any::<u8>()) {
        let mut source = PupilCoreSource::new("127.0.0.1", 1, 0);
        let _ = source.take(&[b"pupil.0".to_vec(), payload], 1_000_000_000);
        let mut real = datum(0, 0.5, 1.0, 1.0, Some(3.0));
        if let Some(byte) = real.get_mut(flip) {
            *byte = to;
        }
        let _ = source.take(&[b"pupil.0".to_vec(), real], 2_000_000_000);
        for sample in &source.ready {
            prop_assert!(sample.readings().all(|(_, r)| !r.valid || r.position.iter().all(|p| p.is_finite())));
            prop_assert!(sample.time_ns <= sample.received_ns);
        }
    }
}

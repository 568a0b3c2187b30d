//! Resolves names to addresses within a time limit, which the system's resolver does not offer.

use eyebox_base::reason;
use std::io::{self, ErrorKind};
use std::net::{IpAddr, SocketAddr, ToSocketAddrs};
use std::sync::mpsc::channel;
use std::time::Duration;

/// Finds the addresses of `host`. A name that takes longer than `timeout` is left to a detached thread.
pub(super) fn resolve(host: &str, port: u16, timeout: Duration) -> io::Result<Vec<SocketAddr>> {
    let name = host.trim_start_matches('[').trim_end_matches(']');
    if let Ok(address) = name.parse::<IpAddr>() {
        return Ok(vec![SocketAddr::new(address, port)]);
    }
    let host = host.to_owned();
    within(timeout, move || Ok((host.as_str(), port).to_socket_addrs()?.collect()))
}

/// Runs `find` on a thread of its own, and waits at most `timeout` for it.
fn within<T: Send + 'static>(
    timeout: Duration,
    find: impl FnOnce() -> io::Result<T> + Send + 'static,
) -> io::Result<T> {
    let (tell, told) = channel();
    std::thread::Builder::new().name("eyebox resolves".into()).spawn(move || drop(tell.send(find())))?;
    told.recv_timeout(timeout).unwrap_or_else(|_| {
        let reason = reason!(
            "name-not-resolved",
            "its name was not resolved within {} s: use its numeric address",
            timeout.as_secs_f64()
        );
        Err(io::Error::new(ErrorKind::TimedOut, reason))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_need_no_resolver_and_a_resolver_that_hangs_is_left() {
        let address = |host| resolve(host, 50020, Duration::ZERO).unwrap();
        assert_eq!(address("127.0.0.1"), [SocketAddr::from(([127, 0, 0, 1], 50020))]);
        assert_eq!(address("[::1]"), [SocketAddr::from(([0, 0, 0, 0, 0, 0, 0, 1], 50020))]);
        let (let_go, held) = channel::<()>();
        let hangs = move || {
            let _ = held.recv();
            Ok(())
        };
        assert_eq!(within(Duration::from_millis(1), hangs).unwrap_err().kind(), ErrorKind::TimedOut);
        drop(let_go);
    }
}

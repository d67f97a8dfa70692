//! Bytes that wait to be written together: fewer and larger writes of a fast sender, little memory for a slow one.

use std::time::Duration;

use tokio::time::Instant;

/// Bytes that are written together at most, or a little more.
const MOST: usize = 256 * 1024;
/// Longest wait for more. A thousand senders at the least rate would otherwise come to hold 256 MiB.
const LONGEST: Duration = Duration::from_secs(1);

/// Bytes that came and were not written yet.
#[derive(Debug, Default)]
pub(super) struct Gathered {
    bytes: Vec<u8>,
    since: Option<Instant>,
}

impl Gathered {
    /// Adds bytes; `true` when it is time to write.
    pub fn add(&mut self, bytes: &[u8], now: Instant) -> bool {
        let since = *self.since.get_or_insert(now);
        self.bytes.extend_from_slice(bytes);
        self.bytes.len() >= MOST || now - since >= LONGEST
    }

    /// Takes them out, to be written.
    pub fn take(&mut self) -> Vec<u8> {
        self.since = None;
        std::mem::take(&mut self.bytes)
    }

    /// Gives their memory back, to serve again.
    pub fn reuse(&mut self, mut written: Vec<u8>) {
        written.clear();
        self.bytes = written;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fast_sender_writes_much_at_once_and_a_slow_one_holds_little() {
        let mut now = Instant::now();
        let mut fast = Gathered::default();
        let pieces = (1..).find(|_| fast.add(&[0; 4096], now)).unwrap();
        assert_eq!(pieces * 4096, MOST);
        let mut slow = Gathered::default();
        for _ in 0..100 {
            now += Duration::from_millis(500);
            if slow.add(&[0; 700], now) {
                let written = slow.take();
                assert!(written.len() <= 3 * 700);
                slow.reuse(written);
            }
        }
        assert!(slow.bytes.capacity() <= 4096);
    }
}

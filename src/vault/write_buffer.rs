//! A write buffer that collects bytes: fewer and larger writes for a fast sender, little memory for a slow one.

use std::time::Duration;

use tokio::time::Instant;

/// Bytes to buffer before a write; the last chunk may exceed it.
const MAX_BUFFERED: usize = 256 * 1024;
/// Maximum time to buffer. Otherwise a thousand senders at the minimum rate would come to hold 256 MiB.
const MAX_WAIT: Duration = Duration::from_secs(1);

/// Bytes that arrived and are not written yet.
#[derive(Debug, Default)]
pub(super) struct WriteBuffer {
    bytes: Vec<u8>,
    since: Option<Instant>,
}

impl WriteBuffer {
    /// Adds bytes; `true` if the buffer should be written now.
    pub fn add(&mut self, bytes: &[u8], now: Instant) -> bool {
        let since = *self.since.get_or_insert(now);
        self.bytes.extend_from_slice(bytes);
        self.bytes.len() >= MAX_BUFFERED || now - since >= MAX_WAIT
    }

    /// Takes the buffered bytes, to be written.
    pub fn take(&mut self) -> Vec<u8> {
        self.since = None;
        std::mem::take(&mut self.bytes)
    }

    /// Returns the memory of written bytes for reuse.
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
        let mut fast = WriteBuffer::default();
        let pieces = (1..).find(|_| fast.add(&[0; 4096], now)).unwrap();
        assert_eq!(pieces * 4096, MAX_BUFFERED);
        let mut slow = WriteBuffer::default();
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

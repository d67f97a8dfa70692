//! Records on a pipe: a length of four bytes, little-endian, then that many bytes.

use std::io::{self, Write};

const HEADER_BYTES: usize = 4;

/// Why no further record can be read from a stream.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RecordError {
    /// A record longer than the budget.
    #[error("a record of {bytes} bytes, above the limit of {limit}")]
    TooLong {
        /// Announced length.
        bytes: usize,
        /// The limit.
        limit: usize,
    },
    /// More output than the budget.
    #[error("more than {limit} bytes of output")]
    TooMuch {
        /// The limit.
        limit: u64,
    },
    /// The stream ended inside a record.
    #[error("the output ends in the middle of a record")]
    Truncated,
    /// The record's content violates the protocol.
    #[error("{0}")]
    Invalid(String),
}

/// Writes one record and flushes it.
pub fn write_record(out: &mut impl Write, record: &[u8]) -> io::Result<()> {
    let length = u32::try_from(record.len())
        .map_err(|_| io::Error::new(io::ErrorKind::InvalidInput, "a record longer than 4 GiB"))?;
    out.write_all(&length.to_le_bytes())?;
    out.write_all(record)?;
    out.flush()
}

/// Splits bytes into records as they arrive, and refuses a length before it allocates memory for it.
pub(super) struct Splitter {
    pending: Vec<u8>,
    record_bytes: usize,
    output_bytes: u64,
    seen: u64,
}

impl Splitter {
    pub(super) fn new(record_bytes: usize, output_bytes: u64) -> Self {
        Self { pending: Vec::new(), record_bytes, output_bytes, seen: 0 }
    }

    /// Takes bytes and passes every record that they complete to `each`; returns the number of records.
    pub(super) fn push(
        &mut self,
        bytes: &[u8],
        mut each: impl FnMut(&[u8]) -> Result<(), String>,
    ) -> Result<usize, RecordError> {
        self.seen += bytes.len() as u64;
        if self.seen > self.output_bytes {
            return Err(RecordError::TooMuch { limit: self.output_bytes });
        }
        self.pending.extend_from_slice(bytes);
        let (mut start, mut records) = (0, 0);
        while let Some(end) = self.end_of_record(start)? {
            each(&self.pending[start + HEADER_BYTES..end]).map_err(RecordError::Invalid)?;
            start = end;
            records += 1;
        }
        self.pending.drain(..start);
        Ok(records)
    }

    /// Fails if the stream ended inside a record.
    pub(super) fn finish(&self) -> Result<(), RecordError> {
        if self.pending.is_empty() { Ok(()) } else { Err(RecordError::Truncated) }
    }

    fn end_of_record(&self, start: usize) -> Result<Option<usize>, RecordError> {
        let Some(head) = self.pending[start..].first_chunk::<HEADER_BYTES>() else { return Ok(None) };
        let bytes = u32::from_le_bytes(*head) as usize;
        if bytes > self.record_bytes {
            return Err(RecordError::TooLong { bytes, limit: self.record_bytes });
        }
        let end = start + HEADER_BYTES + bytes;
        Ok((end <= self.pending.len()).then_some(end))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn split(bytes: &[u8], piece: usize) -> (Vec<Vec<u8>>, Result<(), RecordError>) {
        let mut splitter = Splitter::new(64, 10_000);
        let mut records = Vec::new();
        for part in bytes.chunks(piece) {
            let keep = |record: &[u8]| {
                records.push(record.to_vec());
                Ok(())
            };
            if let Err(error) = splitter.push(part, keep) {
                return (records, Err(error));
            }
        }
        (records, splitter.finish())
    }

    proptest! {
        #[test]
        fn records_come_out_as_they_went_in_however_the_pipe_cuts_them(
            records in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..64), 0..20),
            piece in 1usize..200,
        ) {
            let mut bytes = Vec::new();
            for record in &records {
                write_record(&mut bytes, record).unwrap();
            }
            let (out, end) = split(&bytes, piece);
            prop_assert_eq!(out, records);
            prop_assert_eq!(end, Ok(()));
        }

        #[test]
        fn arbitrary_bytes_are_split_or_refused_but_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
            let _ = split(&bytes, 7);
        }
    }

    #[test]
    fn a_length_above_the_limit_is_refused_before_its_bytes_arrive() {
        assert_eq!(split(&[65, 0, 0, 0], 4).1, Err(RecordError::TooLong { bytes: 65, limit: 64 }));
    }

    #[test]
    fn an_end_inside_a_record_is_an_error() {
        assert_eq!(split(&[3, 0, 0, 0, 1], 5).1, Err(RecordError::Truncated));
    }

    #[test]
    fn output_beyond_the_budget_is_refused() {
        let mut splitter = Splitter::new(64, 100);
        assert_eq!(splitter.push(&[0; 101], |_| Ok(())), Err(RecordError::TooMuch { limit: 100 }));
    }
}

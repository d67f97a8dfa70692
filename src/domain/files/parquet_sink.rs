//! Where Parquet writers put their bytes, so that a table can be sent while it is written.

use std::io::{self, Write};
use std::mem;
use std::sync::{Arc, Mutex, PoisonError};

/// A buffer shared between the Parquet writer, which fills it, and the table, which takes the bytes to send.
#[derive(Clone, Default)]
pub(super) struct ParquetSink(Arc<Mutex<Vec<u8>>>);

impl ParquetSink {
    /// The bytes since the last call.
    pub(super) fn take(&self) -> Vec<u8> {
        mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Write for ParquetSink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

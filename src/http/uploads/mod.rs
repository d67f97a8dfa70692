//! Resumable uploads: tus 1.0.0 with creation, creation-with-upload, termination, checksum and expiration.
//!
//! [`crate::intake::tus`] parses the headers, [`crate::intake`] stores the bytes; this module connects both to
//! HTTP. The answer to the last byte, and every later request for the offset, carries `Trocar-Session`. It also
//! carries `Trocar-Duplicate` if the session existed before: the same recording of the same trainee, task and box
//! is one session.

mod append;
mod create;
mod headers;
mod progress_headers;

pub use append::*;
pub use create::*;
pub use headers::check_tus_version;

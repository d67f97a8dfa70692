//! Resumable uploads: tus 1.0.0 with creation, creation-with-upload, termination, checksum and expiration.
//!
//! What the headers mean stands in [`crate::intake::tus`], what is done with the bytes in [`crate::intake`]; here the two
//! meet HTTP. The answer to the last byte, and every later question, carries `Trocar-Session`; and `Trocar-Duplicate`
//! when that session was there before, because the same recording of the same trainee, task and box is one session.

mod answer;
mod append;
mod create;
mod headers;

pub use append::*;
pub use create::*;
pub use headers::speak_tus;

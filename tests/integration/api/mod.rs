//! REST, roles and uploads, as a client sees them.

mod centre;
mod documents;
mod hostile;
mod nouns;
mod playback;
mod roles;
mod sign_in;
mod streams;
mod tus;
mod uploads;

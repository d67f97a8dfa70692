//! REST, roles and uploads, as a client sees them.

mod advice;
mod box_question;
pub mod centre;
mod courses;
mod documents;
mod edits;
mod exchange;
pub mod full_disk;
mod hostile;
mod looks;
mod models;
mod nouns;
mod overview;
mod owners;
mod passwords;
mod playback;
mod problems;
mod process;
mod progress;
mod progress_load;
mod ratings;
mod replaced_routes;
mod rescoring;
mod rights;

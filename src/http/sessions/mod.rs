//! Sessions: recordings, their status, results, files, ratings, comments, error sheets, edits and moves.

mod comments;
mod cuts;
mod edits;
mod error_sheets;
mod evidence;
mod features;
mod files;
mod import;
mod live;
mod moves;
mod ratings;
mod read;
mod results;
mod send;
mod show;
mod trajectory;
mod watched;

pub use comments::*;
pub use cuts::*;
pub use edits::*;
pub use error_sheets::*;
pub use evidence::*;
pub use features::*;
pub use files::*;
pub use import::*;
pub use live::*;
pub use moves::*;
pub use ratings::*;
pub use read::*;
pub use results::*;
pub use send::*;
pub use show::*;
pub use trajectory::*;
pub use watched::WatchedSessions;

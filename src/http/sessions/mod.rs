//! Recordings that are here, how they stand, and what came of them.

mod files;
mod live;
mod read;
mod send;
mod show;
mod trajectory;

pub use files::*;
pub use live::*;
pub use read::*;
pub use send::*;
pub use show::*;
pub use trajectory::*;

//! Recordings that are here, how they stand, and what came of them.

mod comments;
mod evidence;
mod files;
mod live;
mod ratings;
mod read;
mod send;
mod show;
mod trajectory;

pub use comments::*;
pub use evidence::*;
pub use files::*;
pub use live::*;
pub use ratings::*;
pub use read::*;
pub use send::*;
pub use show::*;
pub use trajectory::*;

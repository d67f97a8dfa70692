//! One-shot child processes that may compute and do nothing else.
//!
//! FFmpeg decodes what strangers send, so it runs where its faults stay: in a child with an empty environment, no file
//! but its open inputs, no network, bounded memory, time and output. The child re-executes this program, takes a
//! request and descriptors over a socket, confines itself ([`admission`]) and only then looks at either; the parent
//! ([`run`]) pumps, watches the clock and counts, and names how it ended ([`Outcome`]).
//!
//! ```text
//! parent                                child
//!   │ socket (stdin): preamble + descriptors │ close what was inherited, die with the parent, receive
//!   │                 request                │ limits → Landlock → seccomp; read the request
//!   │◀ pipe (stdout): length-prefixed records │ work
//!   │◀ pipe (stderr): a bounded tail          │
//!   │ pidfd, stop switch, two clocks          │ exit
//! ```
//!
//! Layers of confinement, each enough to refuse the known attacks alone: no file can be opened (seccomp answers `EACCES`),
//! no file could be reached (Landlock), nothing can be created or executed, any other system call kills.
//! What the child says is hostile input again: this module bounds its size, the caller checks its sense.

mod admission;
mod budget;
mod confinement;
mod footprint;
mod kernel;
mod outcome;
mod parent;
mod record;
mod slice;
mod stop;
mod syscalls;

pub use admission::{Admission, MOST_INPUTS, admit};
pub use budget::{Budget, LandlockPolicy};
pub use confinement::{ConfinementError, Enforced};
pub use kernel::{NoLandlock, landlock};
pub use outcome::{Cost, Ended, Limit, Outcome};
pub use parent::{Order, Program, run};
pub use record::{RecordError, write_record};
pub use stop::Stop;

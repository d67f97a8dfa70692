//! One-shot child processes that may compute and do nothing else.
//!
//! FFmpeg decodes untrusted files, so it runs where its faults do no harm: in a child with an empty environment, no
//! files but its open inputs, no network, and limits on memory, time and output. The child re-executes this program,
//! receives a request and descriptors over a socket, confines itself ([`admission`]) and only then reads them. The
//! parent ([`run`]) moves the data, enforces the limits, and classifies how the child ended ([`ChildOutcome`]).
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
//! Each layer of confinement is enough to stop the known attacks: no file can be opened (seccomp answers `EACCES`), no
//! file could be reached (Landlock), nothing can be created or executed, and any other system call kills the child. The
//! child's output is untrusted input again: this module limits its size, the caller validates its content.

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

pub use admission::{Admission, MAX_INPUTS, admit};
pub use budget::{Budget, LandlockPolicy};
pub use confinement::{ConfinementError, LandlockStatus};
pub use kernel::{LandlockUnavailable, landlock_version};
pub use outcome::{ChildEnd, ChildOutcome, Cost, TimeLimit};
pub use parent::{ChildSpec, Program, run};
pub use record::{RecordError, write_record};
pub use slice::run_soon_after_waking;
pub use stop::StopSwitch;

//! What a child gives up for good, also for its later threads.

use std::io;

use landlock::{
    ABI, Access, AccessFs, AccessNet, CompatLevel, Compatible, Ruleset, RulesetAttr, RulesetError, RulesetStatus, Scope,
};
use rustix::process::{Resource, Rlimit, Signal, getppid, set_parent_process_death_signal, setrlimit};
use rustix::thread::set_no_new_privs;

use super::budget::LandlockPolicy;
use super::footprint;
use super::slice;
use super::syscalls;
use crate::heap;

/// Newest Landlock version whose rights were reviewed; older kernels enforce the part that they know.
const LANDLOCK: ABI = ABI::V6;

/// The limits that a child imposes on itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Confinement {
    /// The process that must outlive the child.
    pub(super) parent: u32,
    /// Memory beyond the program's own, bytes.
    pub(super) memory_bytes: u64,
    /// CPU time, s.
    pub(super) cpu_s: u64,
    /// Length of its CPU time slices, ns.
    pub(super) slice_ns: u64,
    /// Largest length of its output file, bytes; 0 without an output file.
    pub(super) file_bytes: u64,
    /// What to do without Landlock.
    pub(super) landlock: LandlockPolicy,
}

/// How much of Landlock the kernel enforces. The system call filter and the limits are always enforced completely.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LandlockStatus {
    /// Everything requested.
    Fully,
    /// The part that an older kernel knows.
    Partly,
    /// Nothing: the kernel has no Landlock, or it is disabled.
    NoLandlock,
}

/// Why a process could not confine itself; it must then not read its input.
#[derive(Debug, thiserror::Error)]
pub enum ConfinementError {
    /// A system call failed.
    #[error("while {doing}: {source}")]
    System {
        /// The operation.
        doing: &'static str,
        /// The system's error.
        source: io::Error,
    },
    /// The parent is gone already.
    #[error("the parent has ended")]
    Orphaned,
    /// Landlock is required, but the kernel has none.
    #[error("the settings require Landlock, which this kernel does not enforce")]
    NoLandlock,
    /// Landlock refused.
    #[error("while entering Landlock: {0}")]
    Landlock(#[from] RulesetError),
    /// The system call filter could not be made.
    #[error("while making the system call filter: {0}")]
    Filter(#[from] seccompiler::BackendError),
    /// The system call filter could not be entered.
    #[error("while entering the system call filter: {0}")]
    Seccomp(#[from] seccompiler::Error),
}

pub(super) fn system_error<E: Into<io::Error>>(doing: &'static str) -> impl FnOnce(E) -> ConfinementError {
    move |source| ConfinementError::System { doing, source: source.into() }
}

/// Dies with the parent from now on.
pub(super) fn tie_to_parent() -> Result<(), ConfinementError> {
    set_parent_process_death_signal(Some(Signal::KILL)).map_err(system_error("tying the child to its parent"))
}

impl Confinement {
    /// Enters all of it. There is no way back.
    pub(super) fn enter(&self) -> Result<LandlockStatus, ConfinementError> {
        self.check_parent()?;
        set_no_new_privs(true).map_err(system_error("giving up new privileges"))?;
        slice::set_length(self.slice_ns);
        self.limit_resources()?;
        let enforced = self.enter_landlock()?;
        limit(Resource::Nofile, 0, 0)?; // what is open stays; entering Landlock needed one more
        for filter in syscalls::filters(std::process::id())? {
            seccompiler::apply_filter_all_threads(&filter)?;
        }
        Ok(enforced)
    }

    /// The death signal is sent only if the parent ends after it was asked for.
    fn check_parent(&self) -> Result<(), ConfinementError> {
        let alive = getppid().is_some_and(|parent| parent.as_raw_nonzero().get().unsigned_abs() == self.parent);
        if alive { Ok(()) } else { Err(ConfinementError::Orphaned) }
    }

    fn limit_resources(&self) -> Result<(), ConfinementError> {
        heap::use_single_heap().map_err(system_error("keeping to one heap"))?;
        let own = footprint::memory_field("self", "VmSize").map_err(system_error("reading the process's own size"))?;
        limit(Resource::As, own + self.memory_bytes, own + self.memory_bytes)?;
        limit(Resource::Cpu, self.cpu_s, self.cpu_s + 5)?; // first SIGXCPU, which names the reason
        limit(Resource::Fsize, self.file_bytes, self.file_bytes)?;
        for resource in [Resource::Core, Resource::Memlock, Resource::Msgqueue] {
            limit(resource, 0, 0)?;
        }
        Ok(())
    }

    /// No file, no port, no signal or abstract socket outside: a rule set without a single rule.
    fn enter_landlock(&self) -> Result<LandlockStatus, ConfinementError> {
        let status = Ruleset::default()
            .set_compatibility(CompatLevel::BestEffort)
            .handle_access(AccessFs::from_all(LANDLOCK))?
            .handle_access(AccessNet::from_all(LANDLOCK))?
            .scope(Scope::from_all(LANDLOCK))?
            .create()?
            .set_compatibility(CompatLevel::BestEffort)
            .restrict_self()?;
        let enforced = match status.ruleset {
            RulesetStatus::FullyEnforced => LandlockStatus::Fully,
            RulesetStatus::PartiallyEnforced => LandlockStatus::Partly,
            RulesetStatus::NotEnforced => LandlockStatus::NoLandlock,
        };
        if self.landlock == LandlockPolicy::Required && enforced == LandlockStatus::NoLandlock {
            return Err(ConfinementError::NoLandlock);
        }
        Ok(enforced)
    }
}

fn limit(resource: Resource, soft: u64, hard: u64) -> Result<(), ConfinementError> {
    setrlimit(resource, Rlimit { current: Some(soft), maximum: Some(hard) })
        .map_err(system_error("limiting the child's resources"))
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::net::TcpListener;

    use super::*;
    use crate::sandbox::landlock_version;

    /// The system call filter refuses the same; without it, only Landlock can.
    #[test]
    fn landlock_alone_refuses_files_and_ports() {
        let confinement = Confinement {
            parent: std::process::id(),
            memory_bytes: 0,
            cpu_s: 0,
            slice_ns: 0,
            file_bytes: 0,
            landlock: LandlockPolicy::Required,
        };
        let inside = move || {
            File::open("/proc/self/status").expect("not confined yet");
            set_no_new_privs(true).unwrap();
            let entered = confinement.enter_landlock();
            if landlock_version().is_err() {
                assert!(matches!(entered, Err(ConfinementError::NoLandlock)), "{entered:?}");
                return;
            }
            assert_ne!(entered.unwrap(), LandlockStatus::NoLandlock);
            let refused = |error: io::Error| error.kind() == io::ErrorKind::PermissionDenied;
            assert!(File::open("/proc/self/status").is_err_and(refused));
            assert!(File::create(std::env::temp_dir().join("never made")).is_err_and(refused));
            if landlock_version().is_ok_and(|version| version >= 4) {
                assert!(TcpListener::bind("127.0.0.1:0").is_err_and(refused));
            }
        };
        // A thread of its own: Landlock confines the thread that enters it.
        std::thread::spawn(inside).join().unwrap();
    }
}

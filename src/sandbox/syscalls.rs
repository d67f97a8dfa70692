//! The system calls that a confined child may make.
//!
//! There are three filters, and the kernel applies the strictest answer. The *allow-list* kills the child for any call
//! that is not on it. The *refusals* turn calls that libraries make by habit (looking for a file, the terminal's size)
//! into an error that they can handle. The *detour* answers `ENOSYS` to `clone3`, whose flags a filter cannot see, so
//! that the C library falls back to `clone`, which is allowed for threads only.

use libc::c_long;
use seccompiler::{
    BackendError, BpfProgram, SeccompAction, SeccompCmpArgLen::Dword, SeccompCmpArgLen::Qword, SeccompCmpOp,
    SeccompCondition, SeccompFilter, SeccompRule,
};

/// Memory, threads, time, and reading and writing open files.
const ALLOWED: &[c_long] = &[
    libc::SYS_brk,
    libc::SYS_clock_getres,
    libc::SYS_clock_gettime,
    libc::SYS_clock_nanosleep,
    libc::SYS_close,
    libc::SYS_exit,
    libc::SYS_exit_group,
    libc::SYS_futex,
    libc::SYS_getcpu,
    libc::SYS_getpid,
    libc::SYS_getrandom,
    libc::SYS_gettid,
    libc::SYS_lseek,
    libc::SYS_madvise,
    libc::SYS_membarrier,
    libc::SYS_mremap,
    libc::SYS_munmap,
    libc::SYS_nanosleep,
    libc::SYS_pread64,
    libc::SYS_read,
    libc::SYS_restart_syscall,
    libc::SYS_rseq,
    libc::SYS_rt_sigaction,
    libc::SYS_rt_sigprocmask,
    libc::SYS_rt_sigreturn,
    libc::SYS_sched_getaffinity,
    libc::SYS_sched_yield,
    libc::SYS_set_robust_list,
    libc::SYS_sigaltstack,
    libc::SYS_write,
    libc::SYS_writev,
];

/// Answered with `EACCES`: libraries that call them by habit continue without them.
const REFUSED: &[c_long] = &[
    libc::SYS_faccessat,
    libc::SYS_faccessat2,
    libc::SYS_fcntl,
    libc::SYS_getcwd,
    libc::SYS_ioctl,
    libc::SYS_newfstatat,
    libc::SYS_openat,
    libc::SYS_prlimit64,
    libc::SYS_readlinkat,
    libc::SYS_sched_setscheduler,
    libc::SYS_statfs,
    libc::SYS_statx,
    libc::SYS_sysinfo,
    libc::SYS_uname,
    #[cfg(target_arch = "x86_64")]
    libc::SYS_access,
    #[cfg(target_arch = "x86_64")]
    libc::SYS_open,
    #[cfg(target_arch = "x86_64")]
    libc::SYS_readlink,
    #[cfg(target_arch = "x86_64")]
    libc::SYS_stat,
];

/// The filters in loading order: each one allows the calls that loading the next one needs.
pub(super) fn filters(own_pid: u32) -> Result<[BpfProgram; 3], BackendError> {
    Ok([
        program(refusals(), SeccompAction::Allow, SeccompAction::Errno(libc::EACCES as u32))?,
        program(vec![(libc::SYS_clone3, vec![])], SeccompAction::Allow, SeccompAction::Errno(libc::ENOSYS as u32))?,
        program(allow_list(own_pid)?, SeccompAction::KillProcess, SeccompAction::Allow)?,
    ])
}

type Rules = Vec<(c_long, Vec<SeccompRule>)>;

fn program(rules: Rules, otherwise: SeccompAction, matched: SeccompAction) -> Result<BpfProgram, BackendError> {
    let arch = std::env::consts::ARCH.try_into()?;
    SeccompFilter::new(rules.into_iter().collect(), otherwise, matched, arch)?.try_into()
}

fn refusals() -> Rules {
    REFUSED.iter().map(|&call| (call, vec![])).collect()
}

fn allow_list(own_pid: u32) -> Result<Rules, BackendError> {
    let mut rules: Rules = ALLOWED.iter().chain(REFUSED).map(|&call| (call, vec![])).collect();
    rules.push((libc::SYS_clone3, vec![])); // answered by the detour
    rules.push((libc::SYS_clone, vec![only_threads()?]));
    rules.push((libc::SYS_mmap, vec![never_executable()?]));
    rules.push((libc::SYS_mprotect, vec![never_executable()?]));
    rules.push((libc::SYS_prctl, vec![argument_equals(0, libc::PR_SET_NAME as u64)?]));
    rules.push((libc::SYS_tgkill, vec![argument_equals(0, own_pid.into())?])); // abort()
    Ok(rules)
}

/// A thread of this process: shares memory, signal handlers and thread group.
fn only_threads() -> Result<SeccompRule, BackendError> {
    let thread = (libc::CLONE_VM | libc::CLONE_SIGHAND | libc::CLONE_THREAD) as u64;
    SeccompRule::new(vec![SeccompCondition::new(0, Qword, SeccompCmpOp::MaskedEq(thread), thread)?])
}

/// Data memory cannot become executable.
fn never_executable() -> Result<SeccompRule, BackendError> {
    SeccompRule::new(vec![SeccompCondition::new(2, Dword, SeccompCmpOp::MaskedEq(libc::PROT_EXEC as u64), 0)?])
}

fn argument_equals(argument: u8, value: u64) -> Result<SeccompRule, BackendError> {
    SeccompRule::new(vec![SeccompCondition::new(argument, Dword, SeccompCmpOp::Eq, value)?])
}

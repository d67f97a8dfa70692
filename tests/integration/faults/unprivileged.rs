//! The service needs no privilege, and says what the system lacks.

use std::io;
use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};

use seccompiler::{BpfProgram, SeccompAction, SeccompFilter};

use super::Centre;
use crate::process::command;

/// The id of the system's user and group without privileges.
const NOBODY: u32 = 65_534;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_user_without_any_privilege_can_run_the_service_and_its_confined_children() {
    if !rustix::process::getuid().is_root() {
        return; // every other test shows it already
    }
    let folder = tempfile::tempdir().unwrap();
    std::os::unix::fs::chown(folder.path(), Some(NOBODY), Some(NOBODY)).unwrap();
    let data = folder.path().join("data");
    let centre = Centre::open_at(folder, data, as_nobody).await;
    assert_eq!(centre.process().status("Uid"), format!("{NOBODY}\t{NOBODY}\t{NOBODY}\t{NOBODY}"));
    assert_eq!(centre.process().status("CapEff"), "0".repeat(16));
    assert_eq!(centre.process().status("Groups"), "");
    let session = centre.send_whole(std::fs::read(centre.scene("clip.mp4")).unwrap()).await;
    centre.ends_with_one_result(&session).await;
}

#[test]
fn where_landlock_is_missing_the_service_says_what_to_do() {
    let data = tempfile::tempdir().unwrap();
    let mut serve = command(data.path());
    without_landlock(&mut serve);
    let ended = serve.stdout(Stdio::null()).output().unwrap();
    let stderr = String::from_utf8(ended.stderr).unwrap();
    assert_eq!(ended.status.code(), Some(1), "{stderr}");
    for needed in ["Landlock", "5.13", "require_landlock"] {
        assert!(stderr.contains(needed), "no {needed} in: {stderr}");
    }
    assert_eq!(stderr.trim_end().lines().count(), 1, "{stderr}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn where_landlock_is_missing_and_not_required_the_system_call_filter_confines_children_alone() {
    let not_required = |command: &mut Command| {
        without_landlock(command);
        command.env("TROCAR_ANALYSIS__REQUIRE_LANDLOCK", "false");
    };
    let centre = Centre::open_with(not_required).await;
    let session = centre.send_whole(std::fs::read(centre.scene("clip.mp4")).unwrap()).await;
    centre.ends_with_one_result(&session).await;
}

fn as_nobody(command: &mut Command) {
    command.uid(NOBODY).gid(NOBODY); // and of no other group
}

/// As on a kernel that has no Landlock: its first call is unknown there.
fn without_landlock(command: &mut Command) {
    let unknown = [(libc::SYS_landlock_create_ruleset, vec![])].into_iter().collect();
    let answer = SeccompAction::Errno(libc::ENOSYS as u32);
    let architecture = std::env::consts::ARCH.try_into().unwrap();
    let filter: BpfProgram =
        SeccompFilter::new(unknown, SeccompAction::Allow, answer, architecture).unwrap().try_into().unwrap();
    let enter = move || seccompiler::apply_filter(&filter).map_err(io::Error::other);
    // SAFETY: between fork and exec the closure makes two system calls with data prepared before; nothing is allocated
    // unless one fails.
    unsafe { command.pre_exec(enter) };
}

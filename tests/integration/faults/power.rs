//! Power cuts at random moments: all acknowledged data is on the disk.
//!
//! The data lie on a separate file system (ext4 in a file, mounted by a loop device). It is shut down without a flush
//! and mounted again: data that was not synced is gone, as after a power cut. `make power-cuts` runs this test, as
//! root.

use std::fs::File;
use std::os::fd::AsRawFd;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use reqwest::StatusCode;
use sha2::{Digest, Sha256};
use tempfile::TempDir;

use super::{Centre, Dice, padded, padded_bytes};
use crate::support::{let_time_pass, poll_until};

/// Bytes of the recording that arrives in pieces.
const UPLOAD: usize = 12 << 20;
/// Bytes that the file system holds.
const SPACE: u64 = 1 << 30;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "mounts a file system, as root: make power-cuts"]
async fn nothing_acknowledged_is_lost_when_the_power_is_cut() {
    let disk = Disk::attach();
    let mut centre = Centre::open_at(tempfile::tempdir().unwrap(), disk.mounted.join("data"), |_| ()).await;
    let clip = std::fs::read(centre.scene("clip.mp4")).unwrap();
    let pieces = padded(&centre.scene("clip.mp4"), UPLOAD);
    let upload = centre.begin_upload(pieces.len()).await;
    let (mut dice, mut acknowledged) = (Dice(0x9e37_79b9_7f4a_7c15), 0);
    let (mut whole, mut done) = (Vec::new(), Vec::new());
    for cut in 0..cuts() {
        let recording = padded_bytes(&clip, clip.len() + 16 + cut);
        whole.push((centre.send_whole(recording.clone()).await, Sha256::digest(&recording)));
        let piece = 1 + dice.below(UPLOAD / (2 * cuts()));
        acknowledged = centre.send_until_killed(&upload, &pieces, acknowledged, piece).await;
        let_time_pass(Duration::from_millis(dice.below(600) as u64)).await; // a random moment for the cut
        done.extend(centre.newly_done(whole.iter().map(|(session, _)| session), &done).await);
        disk.cut();
        centre.kill();
        disk.mount_again().await;
        centre.restart().await;
        let kept = centre.offset(&upload).await;
        assert!(kept >= acknowledged, "cut {cut}: {acknowledged} bytes were acknowledged, {kept} are there");
        acknowledged = kept;
        centre.check_still_has(&whole, &done).await;
    }
    let session = centre.send_rest(&upload, &pieces, acknowledged).await;
    whole.push((session, Sha256::digest(&pieces)));
    centre.check_still_has(&whole, &done).await;
    for (session, _) in &whole {
        centre.ends_with_one_result(session).await;
    }
    centre.kill();
    assert_eq!(centre.check(), "");
    eprintln!(
        "{} cuts, {} results seen before a cut; ready again after {:?} at most",
        cuts(),
        done.len(),
        centre.slowest_start
    );
}

impl Centre {
    /// The sessions that are done and not yet among the known ones.
    async fn newly_done(&self, sessions: impl Iterator<Item = &String>, known: &[String]) -> Vec<String> {
        let mut new = Vec::new();
        for session in sessions.filter(|session| !known.contains(session)) {
            let seen = super::centre::json_of(self.get(&format!("/sessions/{session}")).await).await;
            new.extend((seen["status"] == "done").then(|| session.clone()));
        }
        new
    }

    /// Checks that recordings are complete and that finished sessions still have their results.
    async fn check_still_has(&self, whole: &[(String, impl AsRef<[u8]>)], done: &[String]) {
        for (session, sum) in whole {
            let video = self.get(&format!("/sessions/{session}/video")).await;
            assert_eq!(video.status(), StatusCode::OK, "recording of {session}");
            assert_eq!(Sha256::digest(video.bytes().await.unwrap()).as_slice(), sum.as_ref(), "recording of {session}");
        }
        for session in done {
            let path = self.get(&format!("/sessions/{session}/trajectory?format=csv")).await;
            assert_eq!(path.status(), StatusCode::OK, "trajectory of {session}");
        }
    }
}

/// A disk whose power can be cut.
struct Disk {
    mounted: PathBuf,
    folder: TempDir,
}

impl Disk {
    fn attach() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let disk = Self { mounted: folder.path().join("mounted"), folder };
        std::fs::create_dir(&disk.mounted).unwrap();
        File::create_new(disk.image()).unwrap().set_len(SPACE).unwrap();
        assert!(tool("mkfs.ext4", &["-q".as_ref(), &disk.image()]), "mkfs.ext4 cannot make a file system");
        disk.mount();
        disk
    }

    fn image(&self) -> PathBuf {
        self.folder.path().join("image")
    }

    fn mount(&self) {
        assert!(
            tool("mount", &["-o".as_ref(), "loop".as_ref(), &self.image(), &self.mounted]),
            "cannot mount the file system; run as root"
        );
    }

    /// Cuts the power: from now on no data reaches the disk, and unwritten data is lost.
    fn cut(&self) {
        /// `_IOR('X', 125, __u32)` of the kernel's `ext4.h`.
        const EXT4_IOC_SHUTDOWN: libc::c_ulong = 0x8004_587d;
        /// Not even the journal is flushed.
        static NO_LOG_FLUSH: u32 = 2;
        let root = File::open(&self.mounted).unwrap();
        // SAFETY: the call reads one `u32` through a valid pointer, on an open descriptor.
        let answer = unsafe { libc::ioctl(root.as_raw_fd(), EXT4_IOC_SHUTDOWN, &raw const NO_LOG_FLUSH) };
        assert_eq!(answer, 0, "{}", std::io::Error::last_os_error());
    }

    async fn mount_again(&self) {
        self.unmount().await;
        self.mount();
    }

    /// Tries again for a while: a child of the service may hold the file system a moment longer.
    async fn unmount(&self) {
        poll_until("the unmount of the file system", || tool("umount", &[&self.mounted])).await;
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        tool("umount", &["-l".as_ref(), &self.mounted]);
    }
}

fn tool(name: &str, arguments: &[&Path]) -> bool {
    Command::new(name).args(arguments).stderr(Stdio::null()).status().is_ok_and(|status| status.success())
}

fn cuts() -> usize {
    std::env::var_os("TROCAR_KILLS").and_then(|n| n.to_str()?.parse().ok()).unwrap_or(3)
}

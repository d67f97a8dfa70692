//! The real `trocar agent stand-by` with a clip as its camera.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use crate::process::program;

/// What a camera shows unless a test needs another picture.
const PICTURE: &str = "testsrc2=size=320x240:rate=25";

/// A running agent. Dropping it kills it.
pub struct StandingAgent {
    child: Child,
    /// Port of its screen.
    pub port: u16,
}

/// What an agent needs: a token, a clip and a spool, in a folder of its own.
pub struct BoxComputer {
    folder: tempfile::TempDir,
    spool: PathBuf,
}

impl BoxComputer {
    /// A computer with this token, and a clip of this length as its camera.
    pub fn new(token: &str, seconds: u32) -> Self {
        Self::with_picture(token, seconds, PICTURE)
    }

    /// The same with a clip of what this filter of FFmpeg draws.
    pub fn with_picture(token: &str, seconds: u32, filter: &str) -> Self {
        Self::of(token, seconds, filter, None)
    }

    /// The same with a spool elsewhere.
    pub fn with_spool(token: &str, seconds: u32, spool: PathBuf) -> Self {
        Self::of(token, seconds, PICTURE, Some(spool))
    }

    fn of(token: &str, seconds: u32, filter: &str, spool: Option<PathBuf>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("token"), token).unwrap();
        let spool = spool.unwrap_or_else(|| folder.path().join("spool"));
        let computer = Self { folder, spool };
        let mut ffmpeg = Command::new("ffmpeg");
        ffmpeg.args(["-v", "error", "-f", "lavfi", "-i", filter, "-t", &seconds.to_string()]);
        assert!(ffmpeg.args(["-c:v", "mjpeg"]).arg(computer.camera()).status().unwrap().success());
        computer
    }

    /// The clip: its end is the end of a camera that is plugged in again at once.
    pub fn camera(&self) -> PathBuf {
        self.folder.path().join("camera.avi")
    }

    pub fn spool(&self) -> PathBuf {
        self.spool.clone()
    }

    /// Starts an agent of box 1 that stands by, with these arguments beside those that it always needs.
    pub fn stand_by(&self, server: &str, arguments: &[&str]) -> StandingAgent {
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let mut agent = program();
        agent.args(["agent", "stand-by", "--box", "box-1", "--server", server, "--screen", &port.to_string()]);
        agent.arg("--token-file").arg(self.folder.path().join("token")).arg("--spool").arg(self.spool());
        agent.args(arguments).arg(self.camera()).stderr(Stdio::inherit());
        StandingAgent { child: agent.spawn().unwrap(), port }
    }

    /// Recordings in the spool.
    pub fn spooled(&self) -> usize {
        let is_recording = |path: &Path| path.is_dir() && path.join("hello.json").exists();
        let entries = std::fs::read_dir(self.spool()).into_iter().flatten().flatten();
        entries.filter(|entry| is_recording(&entry.path())).count()
    }
}

impl StandingAgent {
    /// An address of its screen.
    pub fn screen(&self, path: &str) -> String {
        format!("http://127.0.0.1:{}{path}", self.port)
    }

    /// Kills it, as a power cut would.
    pub fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }
}

impl Drop for StandingAgent {
    fn drop(&mut self) {
        let _ = self.child.kill(); // SIGKILL; it may have ended already
        let _ = self.child.wait();
    }
}

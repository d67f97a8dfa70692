//! The agent's state, in one line for display.

use std::time::Instant;

use super::Agent;

/// The agent's state.
#[derive(Debug)]
pub struct Status {
    /// Frames captured in this run.
    pub captured: u64,
    /// Frames and gaps of the recording that the server has acknowledged.
    pub acknowledged: u64,
    /// True if a server has sent a welcome in this run.
    pub was_welcome: bool,
    is_connected: bool,
    since: Instant,
    message: String,
}

impl Default for Status {
    fn default() -> Self {
        let since = Instant::now();
        Self {
            captured: 0,
            acknowledged: 0,
            was_welcome: false,
            is_connected: false,
            since,
            message: "connecting".into(),
        }
    }
}

impl Status {
    /// A connection was established.
    pub fn connected(&mut self) {
        (self.is_connected, self.was_welcome, self.since) = (true, true, Instant::now());
        self.message = "welcome".into();
    }

    /// There is no connection, or it has ended.
    pub fn disconnected(&mut self, why: &str) {
        if self.is_connected {
            (self.is_connected, self.since) = (false, Instant::now());
        }
        self.message = why.to_owned();
    }
}

/// The state as one line.
pub fn line(agent: &Agent) -> String {
    let (waiting, bytes, spool) = {
        let spool = agent.spool();
        let all = spool.ids().into_iter().filter_map(|id| spool.get(id));
        let (frames, bytes) = all.map(|recording| recording.waiting()).fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        (frames, bytes, spool.bytes())
    };
    let status = agent.status();
    let link = if status.is_connected { "connected" } else { "AWAY" };
    let seconds = status.since.elapsed().as_secs();
    format!(
        "{link} {}:{:02} · captured {} · acknowledged {} · waiting {waiting} ({:.1} MB) · spool {:.1} MB · {}",
        seconds / 60,
        seconds % 60,
        status.captured,
        status.acknowledged,
        bytes as f64 / 1e6,
        spool as f64 / 1e6,
        status.message,
    )
}

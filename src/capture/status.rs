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
    link: ServerLink,
    since: Instant,
    message: String,
}

/// The link to the server.
///
/// ```text
/// NeverConnected ──welcome──▶ Connected ──connection ends──▶ Away ──welcome──▶ Connected
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ServerLink {
    /// No server has sent a welcome in this run.
    NeverConnected,
    Connected,
    /// The connection has ended.
    Away,
}

impl Default for Status {
    fn default() -> Self {
        let since = Instant::now();
        Self { captured: 0, acknowledged: 0, link: ServerLink::NeverConnected, since, message: "connecting".into() }
    }
}

impl Status {
    /// A connection was established.
    pub fn connected(&mut self) {
        (self.link, self.since) = (ServerLink::Connected, Instant::now());
        self.message = "welcome".into();
    }

    /// There is no connection, or it has ended.
    pub fn disconnected(&mut self, why: &str) {
        if self.link == ServerLink::Connected {
            (self.link, self.since) = (ServerLink::Away, Instant::now());
        }
        self.message = why.to_owned();
    }

    /// True if a server has sent a welcome in this run.
    pub fn was_welcome(&self) -> bool {
        self.link != ServerLink::NeverConnected
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
    let link = if status.link == ServerLink::Connected { "connected" } else { "AWAY" };
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

//! Connects to the server again and again until a recording is complete there.

use std::time::Duration;

use super::Agent;
use super::connection::{Parting, Server};
use crate::ids::{FeedId, SessionId};
use crate::time::{Clock, System};

/// First and longest pause after a connection; each pause is twice the one before.
const PAUSE: Duration = Duration::from_millis(500);
const LONGEST_PAUSE: Duration = Duration::from_secs(15);

/// The result of sending a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It is complete on the server.
    Whole(SessionId),
    /// It has no frames.
    Empty,
    /// The server refuses it: why, and what to do. The recording stays in the spool.
    Refused(String),
}

/// Sends a recording of the spool until it is complete, over as many connections as needed.
pub async fn send(agent: &Agent, server: &Server, mut id: FeedId) -> Outcome {
    let mut pause = PAUSE;
    wait_for_a_frame(agent, id).await;
    loop {
        match server.converse(agent, id).await {
            Parting::Whole(_) if was_ended_early(agent, id) => match renew(agent, id) {
                Ok(new) => id = new,
                Err(error) => return Outcome::Refused(format!("the spool cannot be written: {error}")),
            },
            Parting::Whole(session) => {
                forget(agent, id);
                return Outcome::Whole(session);
            }
            Parting::Empty => {
                forget(agent, id);
                return Outcome::Empty;
            }
            Parting::Refused(why) => {
                let kept = agent.spool().path(id);
                agent.status().away(&why);
                tracing::error!(recording = %id, why, "the server refused the recording; it stays in the spool");
                return Outcome::Refused(format!("{why}. The recording stays in {}", kept.display()));
            }
            Parting::Again { why, was_welcome } => {
                if was_welcome {
                    pause = PAUSE;
                }
                agent.status().away(&why);
                tracing::warn!(why, pause_ms = pause.as_millis() as u64, "no connection; next attempt after the pause");
                tokio::time::sleep(pause).await;
                pause = (2 * pause).min(LONGEST_PAUSE);
            }
        }
    }
}

/// Waits until a new recording has a frame, so that no empty recording reaches the server.
async fn wait_for_a_frame(agent: &Agent, id: FeedId) {
    loop {
        {
            let spool = agent.spool();
            if spool.live() != Some(id) || spool.get(id).is_none_or(|recording| recording.end > 0) {
                return;
            }
        }
        agent.0.changed.notified().await;
    }
}

/// True if the server ended the recording, after too long a silence, before the agent had sent the end.
fn was_ended_early(agent: &Agent, id: FeedId) -> bool {
    let spool = agent.spool();
    let is_live = spool.live() == Some(id);
    spool.get(id).is_some_and(|recording| !recording.is_closing() && (is_live || recording.at_or_after(0).is_some()))
}

/// Makes the remaining frames a recording of their own. Some seconds before them may be in both.
fn renew(agent: &Agent, id: FeedId) -> std::io::Result<FeedId> {
    let new = FeedId::at(System.now_ms());
    agent.spool().renew(id, new)?;
    tracing::warn!(ended = %id, recording = %new, "recording ended by the server; remaining frames become a new one");
    Ok(new)
}

fn forget(agent: &Agent, id: FeedId) {
    if let Err(error) = agent.spool().remove(id) {
        tracing::warn!(recording = %id, %error, "a complete recording cannot be removed from the spool");
    }
}

//! Connects to the server again and again until a recording is complete there.

use std::time::Duration;

use super::Agent;
use super::connection::{DisconnectOutcome, Server, is_same_reason};
use crate::ids::{FeedId, SessionId};
use crate::time::{Clock, SystemClock};

/// First and longest pause after a connection; each pause is twice the one before.
const MIN_PAUSE: Duration = Duration::from_millis(500);
const MAX_PAUSE: Duration = Duration::from_secs(15);

/// The result of sending a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SendOutcome {
    /// It is complete on the server.
    Complete(SessionId),
    /// It has no frames.
    Empty,
    /// The server refuses it: why, and what to do. The recording stays in the spool.
    Refused(String),
}

/// Sends a recording of the spool until it is complete, over as many connections as needed.
pub async fn send(agent: &Agent, server: &Server, mut id: FeedId) -> SendOutcome {
    let (mut pause, mut last) = (MIN_PAUSE, String::new());
    wait_for_a_frame(agent, id).await;
    loop {
        match server.run(agent, id).await {
            DisconnectOutcome::Complete(_) if was_ended_early(agent, id) => match continue_as_new(agent, id) {
                Ok(new) => id = new,
                Err(error) => return SendOutcome::Refused(format!("the spool cannot be written: {error}")),
            },
            DisconnectOutcome::Complete(session) => {
                remove_from_spool(agent, id);
                return SendOutcome::Complete(session);
            }
            DisconnectOutcome::Empty => {
                remove_from_spool(agent, id);
                return SendOutcome::Empty;
            }
            DisconnectOutcome::Refused(why) => {
                let kept = agent.spool().path(id);
                agent.status().disconnected(&why);
                tracing::error!(recording = %id, why, "the server refused the recording; it stays in the spool");
                return SendOutcome::Refused(format!("{why}. The recording stays in {}", kept.display()));
            }
            DisconnectOutcome::Retry { why, was_welcome } => {
                if was_welcome {
                    (pause, last) = (MIN_PAUSE, String::new());
                }
                agent.status().disconnected(&why);
                if !is_same_reason(&why, &last) {
                    tracing::warn!(why, "no connection; tried again until there is one");
                }
                last = why;
                tokio::time::sleep(pause).await;
                pause = (2 * pause).min(MAX_PAUSE);
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
fn continue_as_new(agent: &Agent, id: FeedId) -> std::io::Result<FeedId> {
    let new = FeedId::at(SystemClock.now_ms());
    agent.spool().renew(id, new)?;
    tracing::warn!(ended = %id, recording = %new, "recording ended by the server; remaining frames become a new one");
    Ok(new)
}

fn remove_from_spool(agent: &Agent, id: FeedId) {
    if let Err(error) = agent.spool().remove(id) {
        tracing::warn!(recording = %id, %error, "a complete recording cannot be removed from the spool");
    }
}
